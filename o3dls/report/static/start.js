// Put the toolbar together, paint for the first time, and only then take the static pictures away.

function fillToolbar() {
  scene.fields.forEach(({ key, label }) => option($("field"), key, label));
  option($("field"), "", "no colour");
  scene.views.forEach(({ name, from }) => button($("views"), name, () => { lookFrom(from); keepWhole(); }));
  button($("reset"), "Reset", resetView);
  $("views-by").textContent = `(by the ${scene.viewsBy})`;
  if (!scene.patient) $("torso").remove();
  Object.keys(scene.ghostStyles).forEach((name) => option($("ghost"), name, name));
  scene.cutNames.forEach((name, axis) => option($("cut"), axis, name));
  if (panels.length > 1) panels.forEach((panel) => { panel.switch = checkbox($("shown"), panel.name, (on) => showPanel(panel, on)); });
  const present = [...scene.points.names, ...(cloud.outliers.some((marks) => marks.includes(1)) ? ["outliers"] : [])];
  present.forEach((name) => checkbox($("kinds"), name, (on) => { settings.kinds[name] = on; paintAllPoints(); }));
  $("labels").parentElement.hidden = !scene.landmarks.length;
  $("hatching").hidden = !scene.remoteness;
}

function showPanel(panel, on) {
  panel.shown = on;
  panel.figure.hidden = !on;
  panels.forEach(noteColour);
  cut();
}

function connectToolbar() {
  $("field").addEventListener("change", () => chooseField($("field").value));
  $("translucent").addEventListener("input", () => setTranslucency(Number($("translucent").value)));
  $("ghost").addEventListener("change", () => showGhost($("ghost").value));
  connectPlane();
  Object.assign($("level"), { min: 0, max: 1, step: 0.005, value: 0.5 });
  $("level").addEventListener("input", cut);
  $("labels").addEventListener("change", () => { settings.labels = $("labels").checked; invalidate(); });
  $("hatched").addEventListener("change", () => { shared.hatched.value = $("hatched").checked; explainWall(); invalidate(); });
  $("step").addEventListener("change", setStep);
  $("picture").addEventListener("click", savePicture);
  $("measure").addEventListener("click", toggleMeasuring);
  document.addEventListener("keydown", letGo);
  panels.forEach(connectPicking);
  const isSigned = () => settings.field.map === "signed";
  connectBar("surface-bar", (range) => { shared.range.value = range; paintAllPoints(); }, () => settings.field.range, isSigned);
  connectBar("point-bar", (range) => { settings.pointRange = range; paintAllPoints(); }, () => scene.points.range);
  connectHandles("surface-bar", () => settings.field.range, isSigned);
  connectHandles("point-bar", () => scene.points.range);
  window.addEventListener("resize", invalidate);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", invalidate);
}

fillToolbar();
connectToolbar();
fillBars();
connectFullscreen();
fillPair();
fillFit();
$("viewer").hidden = false;
document.getElementById("pictures").classList.add("live");
listWorst();
showBar("point-bar", "points", `points: distance to the surface, ${scene.units}`, scene.points.range);
chooseField($("field").value);
setTranslucency(0);
resetView();
connectLink();
requestAnimationFrame(() => { document.documentElement.dataset.ready = Math.round(performance.now()); });
