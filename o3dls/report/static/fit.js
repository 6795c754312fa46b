// The fit as a slider of the last picture: estimates are its stops, and between two that have the prior's faces the wall moves in straight lines.

const fit = { at: 0, geometry: null, places: [] }; // places: the vertices of each stop; undefined: it has other faces

const fitPanel = () => panels[panels.length - 1];
const stopOf = (estimate) => scene.fit.stops.findIndex((stop) => stop.estimate === estimate);
const isBetween = (panel) => Boolean(fit.geometry) && panel.geometry === fit.geometry;

function fillFit() {
  $("fit-tools").hidden = !scene.fit;
  if (!scene.fit) return;
  const { stops } = scene.fit;
  Object.assign($("fit"), { min: 0, max: stops.length - 1, step: 0.05, value: stops.length - 1 });
  $("fit").addEventListener("input", () => moveFit(Number($("fit").value)));
  stops.forEach(({ estimate }, k) => button($("stops"), scene.estimates[estimate].name, () => moveFit(k)));
  followEstimate(fitPanel());
}

// To a stop, or a place between two.
function moveFit(at) {
  const { stops } = scene.fit;
  const [before, share] = [Math.floor(at), at - Math.floor(at)];
  const near = Math.round(at);
  const straight = share > 0 && [before, before + 1].every((k) => stops[k].positions !== null);
  if (straight) placeBetween(before, share);
  const panel = fitPanel();
  setEstimate(panel, stops[near].estimate); // by which its points are judged
  if (straight) {
    panel.geometry = fit.geometry;
    panel.sides.forEach((side) => { side.geometry = fit.geometry; });
  }
  showFit(panel, straight ? at : near);
}

function showFit(panel, at) {
  noteFit(at);
  colourPanel(panel);
  panels.forEach(noteColour);
  if (pair.on) {
    $("pair-right").value = panel.estimate;
    showHalves();
  }
  listWorst();
  cut();
  refreshReadout();
}

// Where the slider stands, and its stops as buttons.
function noteFit(at) {
  const { stops } = scene.fit;
  const name = (k) => scene.estimates[stops[k].estimate].name;
  const [before, share] = [Math.floor(at), Math.round(100 * (at - Math.floor(at)))];
  fit.at = at;
  $("fit").value = at;
  $("fit").setAttribute("aria-valuetext", share ? `${share} % of the way from ${name(before)} to ${name(before + 1)}` : name(before));
  [...$("stops").children].forEach((made, k) => made.setAttribute("aria-pressed", String(k === at)));
}

// After another estimate was chosen for a picture.
function followEstimate(panel) {
  if (!scene.fit || panel !== fitPanel() || stopOf(panel.estimate) < 0) return;
  noteFit(stopOf(panel.estimate));
}

function placesOf(stop) {
  fit.places[stop] ??= unpackPositions(scene.fit.stops[stop].positions);
  return fit.places[stop];
}

// The wall between a stop and the next one, with as much of the chosen colour as both have.
function placeBetween(before, share) {
  const [from, to] = [placesOf(before), placesOf(before + 1)];
  fit.geometry ??= decodeMesh({ ...scene.fit, positions: scene.fit.stops[before].positions });
  const position = fit.geometry.getAttribute("position");
  for (let i = 0; i < from.length; i++) position.array[i] = from[i] + share * (to[i] - from[i]);
  position.needsUpdate = true;
  fit.geometry.computeVertexNormals();
  fit.geometry.computeBoundingSphere();
  fit.geometry.boundingBox = null;
  if (!fit.geometry.getAttribute("remoteness")) setAttribute(fit.geometry, "remoteness", null);
}

function colourBetween() {
  const { key, names } = settings.field ?? {};
  const before = Math.floor(fit.at);
  const count = fit.geometry.getAttribute("position").count;
  const [from, to] = [before, before + 1].map((k) => {
    const data = scene.meshes[scene.estimates[scene.fit.stops[k].estimate].mesh].fields[key];
    const values = data && unpack(data);
    return values?.length === count ? values : new Float32Array(count).fill(MISSING);
  });
  const share = names?.length ? Math.round(fit.at - before) : fit.at - before; // nothing lies between two regions
  setAttribute(fit.geometry, "value", null);
  const value = fit.geometry.getAttribute("value");
  for (let i = 0; i < count; i++) if (from[i] > -1e20 && to[i] > -1e20) value.array[i] = from[i] + share * (to[i] - from[i]);
}
