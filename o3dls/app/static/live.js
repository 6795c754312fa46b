// A live session of the case: begun here, and used on a page of its own.

const ASKED = { watch: "Its path in the folder of the app", igtl: "Its address, HOST:PORT" };

function tellAsked() {
  byId("live-asked").textContent = ASKED[byId("live-source").value];
}

async function beginLive() {
  const button = byId("begin-live");
  button.disabled = true;
  say(byId("live-said"), "The session begins …");
  const answer = await ask("live", { case: app.case, source: byId("live-source").value, place: byId("live-place").value.trim() });
  button.disabled = false;
  if (answer.error) return say(byId("live-said"), answer.error, true);
  say(byId("live-said"), `The session is open, and writes to ${answer.record}. `);
  const link = made("a", "Go to its page", { href: answer.link, target: "_blank", rel: "noopener" });
  byId("live-said").append(link);
  return link.focus();
}

byId("live-source").addEventListener("change", tellAsked);
byId("begin-live").addEventListener("click", beginLive);
tellAsked();
