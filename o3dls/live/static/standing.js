// What is known now, in words and numbers, and the scene of the viewer once it has come.

const byId = (id) => document.getElementById(id);
const millimetres = (value) => (value === null || value === undefined ? "–" : `${value.toFixed(2)} mm`);
const session = { view: null, scene: null, posed: false, points: new Map(), newest: null, tip: null, landmarks: [], next: [], acts: false, connected: false, ended: false, place: null };

function write(id, text) {
  if (byId(id).textContent !== String(text)) byId(id).textContent = text;
}

// The first scene starts the viewer; a later one moves it, or where its faces or fields are others the page loads anew, in the same view.
function takeScene(event) {
  const [started, same] = [session.scene !== null, event.posed === session.posed];
  Object.assign(session, { scene: event.id, posed: event.posed, landmarks: event.landmarks ?? [] });
  if (!started) startPicture(event.scene);
  else if (session.view && !(same && session.view.takeScene(event.scene))) return location.reload();
  byId("unplaced").hidden = session.posed;
  return showAll();
}

function startPicture(scene) {
  const data = document.createElement("script");
  Object.assign(data, { type: "application/json", id: "scene", textContent: JSON.stringify(scene) });
  document.body.append(data);
  write("title", scene.name);
  document.title = `${scene.name}: o3dls live`;
  session.view = startViewer() ?? null;
  write("waiting", session.view ? "" : "This browser has no WebGL: the surface cannot be drawn. Everything else works.");
  byId("waiting").hidden = Boolean(session.view);
}

function showAll() {
  showPointsNow();
  session.view?.showLandmarks(session.landmarks);
  session.view?.showNext(session.posed ? session.next : []);
  session.view?.showTip(session.posed ? session.tip : null);
  listLandmarks();
}

function takeSurface(event) {
  if (event.of !== session.scene) return; // of a scene that is still to come
  session.view?.moveSurface(event);
  if (event.landmarks) {
    session.landmarks = event.landmarks;
    session.view?.showLandmarks(session.landmarks);
    listLandmarks();
  }
  requestAnimationFrame(() => { document.documentElement.dataset.drawn = event.seq; }); // after the picture, which asked before
}

function takePoint(event) {
  if (event.undone) session.points.delete(event.id);
  else session.points.set(event.id, { ...session.points.get(event.id), ...event });
  const ids = [...session.points.keys()];
  session.newest = ids.length ? Math.max(...ids) : null;
  showPointsNow();
}

function takePoints({ points }) {
  session.points = new Map(points.map((one) => [one.id, one]));
  session.newest = points.length ? Math.max(...points.map(({ id }) => id)) : null;
  showPointsNow();
}

function takeWeights({ ids, weights, distances }) {
  ids.forEach((id, k) => {
    const known = session.points.get(id);
    if (known) Object.assign(known, { weight: weights[k], distance: distances[k] });
  });
  showPointsNow();
}

function showPointsNow() {
  const points = [...session.points.values()].filter(({ type }) => type !== "landmark").sort((a, b) => a.id - b.id);
  const shown = session.posed ? points : [];
  session.view?.showPoints(shown, session.newest);
  document.documentElement.dataset.points = session.points.size;
  tellChosen();
}

function takeState(state) {
  write("points-now", state.fitted === undefined ? state.points : `${state.points}, ${state.fitted} fitted`);
  write("mapped-now", millimetres(state.mapped_mm));
  write("unmapped-now", millimetres(state.unmapped_mm));
  write("fit-now", fitNow(state));
  session.behind = state.behind ?? 0;
  session.unfitted = state.points > 0 && state.fitted === 0;
  tellNow();
  write("source-now", state.source ?? "none: points come from this page");
  byId("source-now").classList.toggle("wrong-now", /hung up|refused|lost/.test(state.source ?? ""));
  write("status-now", state.status ?? "");
  byId("no-points").hidden = session.ended || state.points !== 0;
  takeTip({ xyz: state.tip ?? null });
  drawHistory(state.history ?? []);
  listNext(state.next ?? [], state.ended);
  listWarnings(state.warnings ?? []);
}

// What the full fit does now, and how old the last one is: the points since then are put in without it.
function fitNow({ fit, behind }) {
  const now = /^\d/.test(fit ?? "") ? `running for ${fit}` : fit ?? "–";
  return behind ? `${now}; the last knew ${counted(behind)} less` : now;
}

const counted = (n) => `${n} point${n === 1 ? "" : "s"}`;

function listNext(places, ended) {
  session.next = places;
  byId("next-list").replaceChildren(...places.map(({ xyz, where, before, after, gain }) => {
    const at = xyz.map((one) => Math.round(one) + 0).join(", ");
    return item(`${where ? `${where} (${at})` : `at ${at}`}: expected error of the wall ${before.toFixed(3)} → ${after.toFixed(3)} mm, ${(100 * gain).toFixed(0)} % of its variance`);
  }));
  write("next-ended", ended ?? "");
  session.view?.showNext(session.posed ? places : []);
}

// Notes, which only inform, apart from warnings, as in the report.
function listWarnings(warnings) {
  const [notes, grave] = [true, false].map((note) => warnings.filter(({ kind }) => (kind === "note") === note));
  byId("no-warnings").hidden = grave.length > 0;
  listRemarks(byId("warning-list"), grave);
  listRemarks(byId("note-list"), notes);
}

function listRemarks(list, remarks) {
  const texts = remarks.map(({ stage, text }) => (stage ? `${stage}: ${text}` : text));
  list.hidden = !texts.length;
  if (list.dataset.texts === texts.join("\n")) return;
  list.dataset.texts = texts.join("\n");
  list.replaceChildren(...texts.map(item));
}

function listLandmarks() {
  const side = (has, name) => (has ? name : `not ${name}`);
  byId("landmark-list").replaceChildren(...session.landmarks.map((one) => item(`${one.name}: ${side(one.prior, "on the prior")}, ${side(one.map, "in the map")}`)));
}

function item(text) {
  const made = document.createElement("li");
  made.textContent = text;
  return made;
}

function takeTip({ xyz }) {
  session.tip = xyz;
  byId("take").disabled = !xyz;
  write("tip-now", xyz ? `Tip at ${xyz.map((one) => one.toFixed(1)).join(", ")}` : "No live tip: points come from the source.");
  session.view?.showTip(session.posed ? xyz : null);
}

// How far the run is that the session ends with, and for how long it has been at it.
function takeProgress({ text }) {
  session.progress = text;
  session.ending ??= setInterval(tellProgress, 1000);
  session.since ??= performance.now();
  tellProgress();
}

function tellProgress() {
  const seconds = Math.round((performance.now() - session.since) / 1000);
  write("ended", `The default pipeline runs on all points (${seconds} s): ${session.progress}`);
  byId("ended").hidden = false;
}

function takeEnd(event) {
  clearInterval(session.ending);
  session.ended = true;
  const line = byId("ended");
  const link = document.createElement("a");
  Object.assign(link, { href: "report", target: "_blank", textContent: "Open the report of the run" });
  line.replaceChildren("The session has ended. ", ...(event.run ? [link, `. The run is in ${event.run}`] : []), event.case ? `, the case in ${event.case}.` : "");
  line.hidden = false;
  allow();
}
