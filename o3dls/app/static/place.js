// The pose that is proposed, by pairs, by a search or by hand: shown at once, and kept where that is asked for.

const proposal = { T: app.T, shown: app.T, asked: null, how: "" }; // asked: the pose whose confidence is worked out; how: what was chosen to be shown; over: whether they are overlaid now
const STEPS = [
  ["← left", "move", -1, 0, 0], ["→ right", "move", 1, 0, 0], ["↑ up", "move", 0, 1, 0], ["↓ down", "move", 0, -1, 0], ["nearer", "move", 0, 0, 1], ["farther", "move", 0, 0, -1],
  ["turn left", "turn", -1, 0, 0], ["turn right", "turn", 1, 0, 0], ["tip up", "turn", 0, 1, 0], ["tip down", "turn", 0, -1, 0], ["roll left", "turn", 0, 0, 1], ["roll right", "turn", 0, 0, -1],
];

function showProposal() {
  const over = document.querySelector("[name=shown]:checked").value === "over";
  const moved = over !== proposal.over;
  Object.assign(proposal, { over, shown: over ? proposal.T : app.beside });
  view?.showAt(proposal.shown);
  if (moved) view?.reframe();
}

function showHow(how) {
  document.querySelector(`[name=shown][value=${how}]`).checked = true;
  showProposal();
}

function propose(T, said, how) {
  proposal.T = T;
  byId("place").disabled = false;
  showHow(how);
  const half = view?.measureGaps(T);
  say(byId("fitted"), `${said}${half === undefined ? "" : `: half of the mapping points are within ${half.toFixed(1)} mm of the corners of the prior`}.`);
  judgeProposal();
}

// One question at a time: poses that come meanwhile are asked about when it is answered, the newest alone.
async function judgeProposal() {
  if (proposal.asked) return;
  while (proposal.asked !== proposal.T) {
    proposal.asked = proposal.T;
    say(byId("sure"), "How sure the points are of it is worked out …");
    const answer = await ask("pose", { case: app.case, T: proposal.T });
    if (proposal.asked === proposal.T) say(byId("sure"), answer.error ?? answer.said, Boolean(answer.error));
  }
  proposal.asked = null;
}

async function findPose() {
  byId("find").disabled = true;
  say(byId("sure"), "All turns of the prior are tried …");
  const answer = await ask("pose", { case: app.case });
  byId("find").disabled = false;
  if (answer.error) return say(byId("sure"), answer.error, true);
  proposal.asked = answer.T; // its confidence is known
  propose(answer.T, "The pose that was found", "over");
  proposal.asked = null;
  return say(byId("sure"), answer.said);
}

async function keepPose() {
  const answer = await ask("place", { case: app.case, T: proposal.T });
  if (answer.error) return say(byId("fitted"), answer.error, true);
  return location.reload();
}

function takeHand({ target }) {
  if (target.value && proposal.shown !== proposal.T) showHow("over");
  view?.takeHand(target.value);
}

function connectPlacing() {
  view?.onPick(takePick);
  view?.onMoved((T) => propose(T, "The pose by hand", "over"));
  byId("middle").addEventListener("click", () => { if (!view?.pinMiddle()) say(byId("pair-now"), "Nothing is in the middle of the picture.", true); });
  byId("undo-pair").addEventListener("click", undoPair);
  byId("find").addEventListener("click", findPose);
  byId("place").addEventListener("click", keepPose);
  for (const one of document.querySelectorAll("[name=shown]")) one.addEventListener("change", () => { proposal.how = one.value; showProposal(); });
  for (const one of document.querySelectorAll("[name=hand]")) one.addEventListener("change", takeHand);
  for (const [text, ...step] of STEPS) {
    const button = made("button", text, { type: "button" });
    button.addEventListener("click", () => {
      if (proposal.shown !== proposal.T) showHow("over");
      view?.step(...step);
    });
    byId("steps").append(button);
  }
  proposal.over = JSON.stringify(app.T) !== JSON.stringify(app.beside);
  document.querySelector(`[name=shown][value=${proposal.over ? "over" : "beside"}]`).checked = true;
  listPairs();
}

if (byId("place")) connectPlacing();
