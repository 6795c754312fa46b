// Pairs of places, one of the prior and one of the map each, and how they fit.

const pairs = [{}]; // the last is the one that is being named

// A place of the picture as one of the prior's own frame: back through the pose by which it is shown.
function inPriorFrame([x, y, z]) {
  const T = app.T;
  const shifted = [x - T[0][3], y - T[1][3], z - T[2][3]];
  const square = T[0].slice(0, 3).reduce((sum, one) => sum + one * one, 0); // of the scale
  return [0, 1, 2].map((column) => [0, 1, 2].reduce((sum, row) => sum + T[row][column] * shifted[row], 0) / square);
}

function takePick({ kind, at }) {
  pairs.at(-1)[kind] = kind === "prior" ? inPriorFrame(at) : at;
  if (pairs.at(-1).prior && pairs.at(-1).map) pairs.push({});
  showPairs();
}

function undoPair() {
  const last = pairs.at(-1);
  if (!last.prior && !last.map && pairs.length > 1) pairs.pop();
  pairs[pairs.length - 1] = {};
  showPairs();
}

async function showPairs() {
  const whole = pairs.filter(({ prior, map }) => prior && map);
  const next = pairs.at(-1);
  say(byId("pair-now"), next.prior ? "Now the point of the map." : next.map ? "Now the place of the prior." : `${whole.length} pairs.`);
  byId("place").disabled = whole.length < 3;
  const answer = whole.length < 3 ? {} : await ask("place", { pairs: whole });
  const said = (k) => (answer.misses ? `: ${answer.misses[k].toFixed(1)} mm off${answer.left_out[k] === null ? "" : `, ${answer.left_out[k].toFixed(1)} mm without it`}` : "");
  byId("pairs").replaceChildren(...whole.map((_, k) => made("li", `pair ${k + 1}${said(k)}`)));
  if (answer.error) say(byId("pair-now"), answer.error, true);
}

async function placePrior() {
  const whole = pairs.filter(({ prior, map }) => prior && map);
  const answer = await ask("place", { case: app.case, pairs: whole });
  if (answer.error) return say(byId("pair-now"), answer.error, true);
  return location.reload();
}

if (byId("place")) {
  view?.onPick(takePick);
  byId("middle").addEventListener("click", () => { if (!view?.pinMiddle()) say(byId("pair-now"), "Nothing is in the middle of the picture.", true); });
  byId("undo-pair").addEventListener("click", undoPair);
  byId("place").addEventListener("click", placePrior);
  showPairs();
}
