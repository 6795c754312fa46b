// The toolbar: every control changes `settings` or a shared uniform, then the panels are painted again.

const $ = (id) => document.getElementById(id);
const settings = {
  field: null,
  kinds: Object.fromEntries([...scene.points.names, "outliers"].map((name) => [name, true])),
  labels: true,
  doubts: true,
  next: true,
  pointRange: scene.points.range.slice(),
  steps: Object.fromEntries(scene.fields.filter((field) => field.step).map((field) => [field.key, field.step])), // of isochrones
};

function option(select, value, text) {
  const made = document.createElement("option");
  made.value = value;
  made.textContent = text;
  select.append(made);
}

function checkbox(group, text, change) {
  const label = document.createElement("label");
  const box = document.createElement("input");
  box.type = "checkbox";
  box.checked = true;
  box.addEventListener("change", () => change(box.checked));
  label.append(box, ` ${text}`);
  group.append(label);
  return label;
}

function button(group, text, press) {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = text;
  made.addEventListener("click", press);
  group.append(made);
}

function chooseField(key) {
  const field = scene.fields.find((one) => one.key === key);
  settings.field = field;
  shared.mapped.value = Boolean(field);
  panels.forEach(colourPanel);
  $("surface-bar").hidden = !field || field.names.length > 0;
  showRegions(field);
  $("point-bar").hidden = Boolean(ownValues(field)) || !cloud.kinds.length;
  if (field) paintField(field);
  showIsochrones(field);
  paintAllPoints();
  refreshReadout();
}

function colourPanel(panel) {
  const { field } = settings;
  const data = field && scene.meshes[panel.mesh].fields[field.key];
  setAttribute(panel.geometry, "value", data);
  if (field && isMoving(panel)) mixField(field);
  softenMissing(panel.geometry);
  if (field?.names.length && data) softenClasses(panel.geometry, data);
  noteColour(panel);
}

function noteColour(panel) {
  const { field } = settings;
  const data = field && scene.meshes[panel.mesh].fields[field.key];
  panel.note.textContent = field && !data ? `no ${field.label} here ` : panel.caption;
  if (field && !data) offerInstead(panel, field);
}

// Instead of a grey picture: the last estimate that has the colour and is not shown, or the other pictures alone, which are larger then.
function offerInstead(panel, { key }) {
  const taken = panels.filter(({ shown }) => shown).map(({ estimate }) => estimate);
  const has = (k) => key in scene.meshes[scene.estimates[k].mesh].fields;
  const other = [...scene.estimates.keys()].reverse().find((k) => has(k) && !taken.includes(k));
  if (other !== undefined) button(panel.note, `Show ${scene.estimates[other].name}`, () => showEstimate(panel, other));
  if (panel.switch && taken.some(has)) button(panel.note, "One large picture", () => panel.switch.querySelector("input").click());
}

function paintField(field) {
  shared.colours.value = textures[field.map];
  const name = field.unit ? `${field.label}, ${field.unit}` : field.label;
  showBar("surface-bar", field.map, `${ownValues(field) ? "wall and points" : "wall"}: ${name}`, field.range);
  $("of-left-out").hidden = !field.key.startsWith("left_out_");
  shared.range.value = field.range.slice();
}

function showIsochrones(field) {
  const step = field ? settings.steps[field.key] : undefined;
  $("isochrones").hidden = step === undefined;
  shared.isochrones.value = step || 0;
  if (step === undefined) return;
  $("step").value = step;
  $("step-unit").textContent = field.unit;
}

function setStep() {
  const step = $("step").valueAsNumber;
  const right = step >= 0; // 0 is none; false for NaN
  $("isochrones").classList.toggle("wrong", !right);
  if (right) settings.steps[settings.field.key] = shared.isochrones.value = step;
  invalidate();
}

function setAttribute(geometry, name, data) {
  const count = geometry.getAttribute("position").count;
  setArray(geometry, name, data ? unpack(data) : new Float32Array(count).fill(MISSING));
}

// Bytes stand for shares within 0 and 1.
function setArray(geometry, name, values, size = 1) {
  const there = geometry.getAttribute(name);
  if (!there) return geometry.setAttribute(name, new THREE.BufferAttribute(values, size, values instanceof Uint8Array));
  there.array.set(values); // a buffer that is replaced would stay on the graphics card
  there.needsUpdate = true;
}

function showBar(id, map, name, range) {
  const bar = $(id);
  bar.dataset.map = map;
  paintColours(bar);
  bar.querySelector(".name").textContent = name;
  writeRange(bar, range);
}

function writeRange(bar, [low, high]) {
  noteHandles(bar, [low, high]);
  bar.querySelector(".low").value = Number(low.toPrecision(3));
  bar.querySelector(".high").value = Number(high.toPrecision(3));
}

// Two ends that can be typed. Those of signed values mirror each other: zero keeps the middle of the colours.
function connectBar(id, apply, automatic, signed = () => false) {
  const bar = $(id);
  const read = () => [".low", ".high"].map((part) => bar.querySelector(part).valueAsNumber);
  const change = ({ target: typed }) => {
    const mirrored = typed.classList.contains("low") ? [typed.valueAsNumber, -typed.valueAsNumber] : [-typed.valueAsNumber, typed.valueAsNumber];
    const [low, high] = signed() ? mirrored : read();
    const right = low < high; // false for NaN too
    bar.classList.toggle("wrong", !right);
    if (!right) return;
    if (signed()) writeRange(bar, [low, high]);
    apply([low, high]);
  };
  bar.querySelectorAll("input").forEach((input) => input.addEventListener("change", change));
  bar.querySelector(".auto").addEventListener("click", () => {
    bar.classList.remove("wrong");
    writeRange(bar, automatic());
    apply(automatic().slice());
  });
}

function paintAllPoints(draw = invalidate) {
  panels.forEach((panel) => paintPoints(panel, settings));
  markBars();
  explainWall();
  draw();
}

function setTranslucency(amount) {
  shared.opacity.value = 1 - amount;
  for (const { sides: [back, front] } of panels) {
    for (const mesh of [back, front]) {
      mesh.material.transparent = amount > 0;
      mesh.material.depthWrite = amount === 0;
      mesh.material.needsUpdate = true;
    }
    [back.renderOrder, front.renderOrder] = [1, 2];
    back.visible = amount > 0; // what hides what is behind it is painted in one go
    front.material.side = amount > 0 ? THREE.FrontSide : THREE.DoubleSide;
  }
  panels.forEach(capPanel);
  invalidate();
}

function showGhost(name) {
  for (const panel of panels) for (const [key, ghost] of Object.entries(panel.ghosts)) ghost.visible = key === name;
  invalidate();
}

function cut() {
  const plane = cutPlane();
  $("level").disabled = !plane;
  $("cut-turn").hidden = $("cut").value !== "free";
  $("cut-flip").hidden = !plane;
  shared.plane.value.copy(plane || NO_PLANE);
  contours = plane ? contourSources().map((source) => ({ ...source, segments: sliceMesh(source.geometry, source.matrix, plane) })) : [];
  panels.forEach(capPanel);
  legend();
  paintAllPoints();
}

// The prior where the last panel has it, the truth, and over them every estimate shown.
function contourSources() {
  const ghosts = Object.entries(panels[panels.length - 1].ghosts);
  return [
    ...ghosts.map(([name, { geometry, matrix }]) => ({ name, ...scene.ghostStyles[name], geometry, matrix })),
    ...panels.filter((panel) => panel.shown && firstOf(panel)).map(({ name, colour, dash, geometry }) => ({ name, colour, dash, geometry })),
  ];
}

function legend() {
  const parts = contours.map(({ name, colour, dash }) => {
    const item = document.createElement("span");
    const line = document.createElement("i");
    line.style.borderTop = `3px ${dash.length ? "dashed" : "solid"} var(${colour})`;
    item.append(line, name);
    return item;
  });
  $("legend").replaceChildren(...parts);
}
