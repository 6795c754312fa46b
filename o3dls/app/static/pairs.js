// Pairs of places, one of the prior and one of the map each.

const pairs = [{}]; // the last is the one that is being named

const wholePairs = () => pairs.filter(({ prior, map }) => prior && map);

// A place of the picture as one of the prior's own frame: back through the pose in which it is shown.
function inPriorFrame([x, y, z], T) {
  const shifted = [x - T[0][3], y - T[1][3], z - T[2][3]];
  const square = T[0].slice(0, 3).reduce((sum, one) => sum + one * one, 0); // of the scale
  return [0, 1, 2].map((column) => [0, 1, 2].reduce((sum, row) => sum + T[row][column] * shifted[row], 0) / square);
}

function takePick({ kind, at }) {
  const pair = pairs.at(-1);
  pair[kind] = kind === "prior" ? inPriorFrame(at, proposal.shown) : at;
  if (pair.prior && pair.map) {
    pair.name = byId("pair-name").value;
    byId("pair-name").value = "";
    pairs.push({});
  }
  followPairs();
}

// First what is half of a pair, then the newest pair.
function undoPair() {
  const last = pairs.at(-1);
  if (!last.prior && !last.map && pairs.length > 1) pairs.pop();
  pairs[pairs.length - 1] = {};
  followPairs();
}

function listPairs({ misses, left_out: leftOut } = {}) {
  const said = (k) => (misses ? `: ${misses[k].toFixed(1)} mm off${leftOut[k] === null ? "" : `, ${leftOut[k].toFixed(1)} mm where the others alone give the pose`}` : "");
  byId("pairs").replaceChildren(...wholePairs().map(({ name }, k) => made("li", `${name || "pair"}${said(k)}`)));
  view?.showPairs(pairs);
  const next = pairs.at(-1);
  say(byId("pair-now"), next.prior ? "Now the point of the map." : next.map ? "Now the place of the prior." : `${pairs.length - 1} pairs.`);
}

async function followPairs() {
  const whole = wholePairs();
  listPairs();
  if (whole.length < 3) return;
  const answer = await ask("fit", { pairs: whole });
  if (whole.length !== wholePairs().length) return; // another click came meanwhile
  if (answer.error) {
    say(byId("pair-now"), answer.error, true);
    return;
  }
  listPairs(answer);
  propose(answer.T, `The fit of ${whole.length} pairs`, proposal.how || "over");
}
