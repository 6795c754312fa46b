// The line under the pictures: the value or the point under the pointer; a click pins it.

const HINT = "Point at a surface to read its value; a click keeps it, Escape lets it go.";
const CLICK = 4; // pixels that a click may move; what moves more turns the pictures
let pinned = null; // what `hit` gave
let hovered = null; // the newest movement that is not yet read

function connectPicking(panel) {
  let pressed = [0, 0];
  panel.canvas.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; });
  panel.canvas.addEventListener("click", (event) => {
    if (Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > CLICK) return;
    const found = hit(panel, event);
    if (measuring.on) measureTo(found);
    else pin(found);
  });
  panel.canvas.addEventListener("pointermove", (event) => {
    if (event.buttons || event.pointerType === "touch") return;
    if (!hovered) requestAnimationFrame(readHovered); // one ray per frame at most
    hovered = { panel, event };
  });
  panel.canvas.addEventListener("pointerleave", () => { hovered = null; refreshReadout(); });
}

function readHovered() {
  const moved = hovered;
  hovered = null;
  if (moved && !holdsLine()) write(describe(hit(moved.panel, moved.event)) || HINT, "off");
}

function pin(found) {
  pinned = found;
  write(describe(found) || HINT, "polite");
  host.dispatchEvent(new Event("pin"));
  invalidate();
}

// After what is shown has changed.
function refreshReadout() {
  if (pinned?.geometry && pinned.geometry !== pinned.panel.geometry) pinned = null;
  if (!measuring.on) write(describe(pinned) || HINT, "off");
}

const holdsLine = () => pinned || measuring.on;

// Only what was asked for is read aloud, not every movement.
function write(text, live) {
  const line = $("readout");
  line.setAttribute("aria-live", live);
  if (line.textContent !== text) line.textContent = text;
}

function describe(found) {
  if (!found) return "";
  return found.point === undefined ? describeWall(found) : describePoint(found.point, found.panel);
}

function describeWall({ panel, geometry, corners, weights }) {
  const { field } = settings;
  if (!field) return `${panel.name}: surface, no colour chosen`;
  const [known, value] = ["known", "shade"].map((name) => geometry.getAttribute(name).array).map((array) => corners.reduce((sum, corner, k) => sum + weights[k] * array[corner], 0));
  if (known < 0.5) return `${panel.name}: no ${field.label} here`; // as the picture is drawn
  if (field.names.length) return `${panel.name}: ${field.label} ${field.names[classAt(geometry, corners, weights)]}`;
  return `${panel.name}: ${field.label} ${withUnit(value, field.unit)}`;
}

function describePoint(i, { name, estimate }) {
  const measured = Object.entries(cloud.values).filter(([, values]) => values[i] > -1e20);
  const unit = (key) => (scene.fields.find((field) => field.key === key) || { unit: "" }).unit;
  return [
    `${nameOf(i)}, ${kindOf(i)}`,
    `${withUnit(cloud.residuals[estimate][i], scene.units)} from ${name}`,
    ...describeBelief(i, estimate),
    ...measured.map(([key, values]) => `${key} ${withUnit(values[i], unit(key))}`),
  ].join("; ");
}

function describeBelief(i, estimate) {
  const belief = cloud.beliefs[estimate][i];
  if (belief > -1e20) return [`belief ${belief.toFixed(2)}`];
  return scene.estimates[estimate].fitted.includes(kindOf(i)) ? [] : ["not fitted"];
}

const withUnit = (value, unit) => `${Number(value.toPrecision(3))} ${unit}`.trim();
const kindOf = (i) => scene.points.names[cloud.kinds[i]];
const nameOf = (i) => (scene.points.ids[i] ? `Point ${scene.points.ids[i]}` : `Row ${cloud.rows[i]} of points.csv`);

function drawPinned(context, width, height, ratio, ink) {
  if (pinned) drawRing(context, project(...pinned.at.toArray(), width, height), 9, ratio, ink);
}

function drawRing(context, [x, y], radius, ratio, ink) {
  for (const [wide, colour] of [[5, getComputedStyle(document.body).backgroundColor], [2, ink]]) {
    context.strokeStyle = colour;
    context.lineWidth = wide * ratio;
    context.beginPath();
    context.arc(x, y, radius * ratio, 0, 2 * Math.PI);
    context.stroke();
  }
}

function letGo(event) {
  if (event.key !== "Escape") return;
  if (measuring.on) stopMeasuring();
  else if (pinned) pin(null);
}
