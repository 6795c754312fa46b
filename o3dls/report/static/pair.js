// Before / after: the first and the last panel as one picture with a divider, one estimate on each side of it; or the two in turn.

const HALF_PERIOD = 600; // ms that each of the two is shown when they alternate: well below three changes a second
const calm = matchMedia("(prefers-reduced-motion: reduce)");
const pair = { on: false, split: 50, flicker: 0, second: false, before: null }; // before: what the panels showed

const pairable = () => scene.estimates.length > 1;
const pairPanels = () => [panels[0], panels[panels.length - 1]];

function fillPair() {
  $("pair").hidden = !pairable();
  if (!pairable()) return;
  if (panels.length < 2) { // one estimate is shown: the other half has a panel of its own
    panels.unshift(makePanel(0, panels.length));
    connectPicking(panels[0]);
    host.prepend(panels[0].figure);
    panels[0].figure.hidden = !(panels[0].shown = false);
  }
  for (const select of [$("pair-left"), $("pair-right")]) {
    scene.estimates.forEach(({ name }, index) => option(select, index, name));
    select.addEventListener("change", choosePair);
  }
  $("pair-left").value = 0; // the pose before registration
  $("pair-right").value = panels[panels.length - 1].estimate;
  $("pair").addEventListener("click", () => setPair(!pair.on));
  $("flicker").addEventListener("click", () => setFlicker(!pair.flicker));
  $("flicker").hidden = calm.matches;
  calm.addEventListener("change", () => { $("flicker").hidden = calm.matches; setFlicker(false); });
  host.append($("divider"));
  connectDivider($("divider"));
}

function setPair(on) {
  if (on === pair.on) return;
  pair.on = on;
  if (on) pair.before = panels.map(({ estimate, shown }) => ({ estimate, shown }));
  host.classList.toggle("pair", on);
  $("pair").setAttribute("aria-pressed", String(on));
  $("shown").hidden = on;
  $("fitting").hidden = on || fit.stops.length < 2;
  $("pair-tools").hidden = $("divider").hidden = !on;
  setFlicker(false);
  panels.forEach((panel, k) => {
    panel.shown = on ? pairPanels().includes(panel) : pair.before[k].shown;
    panel.figure.hidden = !panel.shown;
    if (!on) setEstimate(panel, pair.before[k].estimate);
  });
  on ? choosePair() : repaint();
}

function choosePair() {
  pairPanels().forEach((panel, k) => setEstimate(panel, Number([$("pair-left"), $("pair-right")][k].value)));
  repaint();
  keepWhole();
  moveDivider(pair.split);
}

// The colours keep their ends.
function repaint() {
  const range = shared.range.value;
  listWorst();
  chooseField($("field").value);
  shared.range.value = range;
  if (settings.field) writeRange($("surface-bar"), range);
  cut();
}

function moveDivider(percent) {
  pair.split = Math.min(100, Math.max(0, percent));
  const [left, right] = pairPanels().map(({ name }) => name);
  const shown = Math.round(pair.split);
  const divider = $("divider");
  divider.setAttribute("aria-valuenow", shown);
  divider.setAttribute("aria-valuetext", `${shown} % ${left}, ${100 - shown} % ${right}`);
  showHalves();
}

// Each half is clipped, since pictures are transparent where nothing is.
function showHalves() {
  const split = pair.flicker ? 100 * !pair.second : pair.split;
  host.style.setProperty("--split", `${split}%`);
  $("divider").classList.toggle("still", Boolean(pair.flicker));
  const [left, right] = pairPanels();
  panels.forEach((panel) => panel.figure.classList.remove("left", "right"));
  left.figure.classList.add("left");
  right.figure.classList.add("right");
  $("name-left").textContent = split > 0 ? left.name : "";
  $("name-right").textContent = split < 100 ? right.name : "";
  invalidate();
}

function setFlicker(on) {
  clearInterval(pair.flicker);
  pair.second = false;
  pair.flicker = on && pair.on && !calm.matches ? setInterval(() => { pair.second = !pair.second; showHalves(); }, HALF_PERIOD) : 0;
  $("flicker").setAttribute("aria-pressed", String(Boolean(pair.flicker)));
  if (pair.on) showHalves();
}

function connectDivider(divider) {
  const percentAt = ({ clientX }) => {
    const box = panels[0].canvas.getBoundingClientRect();
    return (100 * (clientX - box.left)) / box.width;
  };
  divider.addEventListener("pointerdown", ({ pointerId }) => divider.setPointerCapture(pointerId));
  divider.addEventListener("pointermove", (event) => {
    if (divider.hasPointerCapture(event.pointerId)) moveDivider(percentAt(event));
  });
  divider.addEventListener("keydown", (event) => {
    const to = { Home: 0, End: 100 }[event.key];
    const step = { ArrowLeft: -2, ArrowDown: -2, ArrowRight: 2, ArrowUp: 2, PageDown: -10, PageUp: 10 }[event.key];
    if (to === undefined && !step) return;
    event.preventDefault();
    moveDivider(to ?? pair.split + step);
  });
}
