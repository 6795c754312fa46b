// The connection: events as they come, whether it stands, and who this page is.

const page = sessionStorage.getItem("page") ?? crypto.randomUUID().replaceAll("-", "");
sessionStorage.removeItem("page"); // only a page that loads anew finds its name again: a copy of its tab is another page
window.addEventListener("pagehide", () => sessionStorage.setItem("page", page));
if (location.search) history.replaceState(null, "", location.pathname + location.hash); // the token is a cookie by now

const TAKES = { scene: takeScene, surface: takeSurface, point: takePoint, points: takePoints, weights: takeWeights, state: takeState, tip: takeTip, role: takeRole, progress: takeProgress, end: takeEnd, error: ({ text }) => say(`Refused: ${text}`, true) };
const seen = { session: "", newest: {} }; // numbers of the events that were taken, which begin anew with a session

// What was told already, as may be after the connection was lost, or by a newer event of its kind.
function isOld({ event, seq }, id) {
  const [name] = id.split("-");
  if (name !== seen.session) Object.assign(seen, { session: name, newest: {} });
  const kind = event === "weights" || event === "point" ? "points" : event;
  if (seq <= (seen.newest[kind] ?? 0)) return true;
  seen.newest[kind] = seq;
  return false;
}

function connect() {
  const source = new EventSource(`events?page=${page}`);
  for (const [kind, take] of Object.entries(TAKES)) {
    source.addEventListener(kind, (message) => {
      if (!message.data) return; // the browser's own word that the connection is lost has the name of ours
      const event = JSON.parse(message.data);
      if (kind === "role" || !isOld(event, message.lastEventId)) take(event);
    });
  }
  source.addEventListener("open", () => {
    session.connected = true;
    tellNow();
    allow();
  });
  source.addEventListener("error", () => { if (source.readyState !== EventSource.OPEN) lose(source); });
}

function lose(source) {
  session.connected = false;
  allow();
  const gone = source.readyState === EventSource.CLOSED;
  if (session.ended) {
    source.close();
    return tellConnection("The session has ended, and its server with it.", "good");
  }
  const more = gone ? "This page is refused: open the link that o3dls live printed, or close another page." : "Trying again.";
  return tellConnection(`Connection lost: what is shown is old. ${more}`, "bad");
}

// The surface knows every point at once; a full fit, which may find another motion, takes its time.
function tellNow() {
  if (!session.connected || session.ended) return;
  if (session.unfitted) tellConnection("Connected: no point is fitted yet; the surface is the prior in its first pose.", "good");
  else if (session.behind) tellConnection(`Connected: the surface knows all points, but its last full fit is ${counted(session.behind)} old.`, "good");
  else tellConnection("Connected: what is shown is now.", "good");
}

function tellConnection(text, grade) {
  write("connection", text);
  byId("connection").className = `overall ${grade}`;
}

connectActions();
tellChosen();
connect();
