// The fit as a motion: a slider moves the first picture's surface through the estimates of the last one's run, in straight lines where they share their faces; a surface of its own faces is a stop that the slider jumps to. Nothing moves by itself.

const fit = { stops: [], geometry: null, faces: null, from: 0, share: 0 }; // stops: indices of estimates; the geometry is between `from` and the next

const meshOf = (k) => scene.meshes[scene.estimates[k].mesh];
const haveSameFaces = (one, other) => meshOf(one).faces === meshOf(other).faces;

// Each once where it moved nothing: the first of such, but at the end the last, which is the result.
function findStops() {
  const { run } = scene.estimates[scene.panels.at(-1)];
  const own = [...scene.estimates.keys()].filter((k) => scene.estimates[k].run === run);
  const isSame = (one, other) => haveSameFaces(one, other) && meshOf(one).positions === meshOf(other).positions;
  const moved = own.filter((k, n) => n === 0 || !isSame(k, own[n - 1]));
  return [...moved.slice(0, -1), own.at(-1)];
}

// Whether the surface can be moved from a stop to the next.
const canMix = (from) => from + 1 < fit.stops.length && haveSameFaces(fit.stops[from], fit.stops[from + 1]);

function fillFit() {
  fit.stops = findStops();
  $("fitting").hidden = fit.stops.length < 2;
  $("fit").max = fit.stops.length - 1;
  fit.stops.forEach((k, n) => option($("fit-stops"), n, scene.estimates[k].name));
  $("fit").addEventListener("input", () => moveFit(Number($("fit").value)));
  $("fit").addEventListener("keydown", (event) => {
    const at = Number($("fit").value);
    const arrow = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key];
    const jump = arrow && Number.isInteger(at) && !canMix(arrow > 0 ? at : at - 1) ? arrow : undefined;
    const step = { PageUp: 1, PageDown: -1 }[event.key] ?? jump;
    if (!step) return;
    event.preventDefault();
    slide("fit", step > 0 ? Math.floor(at) + 1 : Math.ceil(at) - 1);
  });
  panels.filter(({ shown }) => shown).slice(0, 1).forEach(({ estimate }) => showStop(Math.max(fit.stops.indexOf(estimate), 0)));
}

const fitPanel = () => panels.find(({ shown }) => shown);
const isMoving = ({ geometry }) => geometry === fit.geometry;

function moveFit(at) {
  const panel = fitPanel();
  if (!panel) return;
  if (!canMix(Math.floor(at))) at = Math.round(at);
  [fit.from, fit.share] = [Math.floor(at), at - Math.floor(at)];
  const nearest = fit.stops[Math.round(at)];
  if (fit.share === 0) return showEstimate(panel, nearest);
  setEstimate(panel, nearest);
  if (fit.faces !== meshOf(nearest).faces) {
    fit.geometry?.dispose();
    [fit.geometry, fit.faces] = [geometryOf(panel.mesh).clone(), meshOf(nearest).faces];
  }
  panel.geometry = fit.geometry;
  panel.sides.forEach((side) => { side.geometry = fit.geometry; });
  const [before, after] = [0, 1].map((n) => geometryOf(scene.estimates[fit.stops[fit.from + n]].mesh));
  mixInto("position", before.getAttribute("position").array, after.getAttribute("position").array);
  for (const name of ["remoteness", "occlusion"]) fit.geometry.getAttribute(name).copy(geometryOf(panel.mesh).getAttribute(name)).needsUpdate = true;
  fit.geometry.computeVertexNormals();
  fit.geometry.boundingSphere = null; // of where it was
  const [first, second] = [0, 1].map((n) => scene.estimates[fit.stops[fit.from + n]].name);
  panel.caption = `${Math.round(100 * fit.share)} % from ${first} to ${second}`;
  panel.name = `between ${first} and ${second}`;
  showStop(at, panel.caption);
  colourPanel(panel);
  cut();
  refreshReadout();
}

function mixInto(name, before, after) {
  const into = fit.geometry.getAttribute(name);
  for (let i = 0; i < into.array.length; i++) into.array[i] = before[i] + fit.share * (after[i] - before[i]);
  into.needsUpdate = true;
}

// Between two estimates a colour that both have.
function mixField({ key }) {
  const [before, after] = [0, 1].map((n) => scene.meshes[scene.estimates[fit.stops[fit.from + n]].mesh].fields[key]);
  if (!before || !after) return setAttribute(fit.geometry, "value", undefined);
  const known = [unpack(before), unpack(after)];
  mixInto("value", ...known);
  const { array } = fit.geometry.getAttribute("value");
  known.forEach((values) => values.forEach((value, i) => { if (!(value > -1e20)) array[i] = MISSING; }));
}

function showStop(at, text = scene.estimates[fit.stops[at]]?.name ?? "") {
  $("fit").value = at;
  $("fit").setAttribute("aria-valuetext", text);
  $("fit-name").textContent = text;
}

// After a panel has got another estimate.
function followFit(panel, estimate) {
  const at = fit.stops.indexOf(estimate);
  if (panel === fitPanel() && at >= 0) showStop(at);
}
