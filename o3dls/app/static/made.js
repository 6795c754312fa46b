// What was said when the case of this page was made here: what was taken and left, and the command that does the same.

const kept = JSON.parse(sessionStorage.getItem(app.case) ?? "null");
if (kept) {
  byId("made").hidden = false;
  byId("made-command").textContent = kept.command;
  byId("made-said").replaceChildren(...kept.said.map((line) => made("li", line)));
}
