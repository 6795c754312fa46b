// The report's viewer kept up to date: positions, fields and points go into the scene that is there. Runs in the viewer's scope.

const TIP = 7; // pixels of an arm of the cross at the catheter's tip
const TELL_AFTER = 150; // ms
const DRAW_AFTER = 150; // ms: what is drawn with the next surface, or after so long without one, as frames take time from the fit
const priorPlaces = unpackPositions(scene.prior.positions, scene.prior.box); // of the same vertices, in the prior's frame
const shownNow = { newest: null, tip: null, points: [], pinnedId: null, telling: 0, drawing: 0 };

offerNext();
$("ghost").parentElement.hidden = true; // nothing to compare with
overlays.push(drawNewest, drawTip);
host.addEventListener("pin", () => {
  shownNow.pinnedId = pinned?.point === undefined ? null : Number(scene.points.ids[pinned.point]);
  onPick(picked());
});

// What is ringed: a point by its number, or a place of the wall with where it is on the prior.
function picked() {
  if (!pinned) return null;
  if (pinned.point !== undefined) return { point: shownNow.pinnedId };
  const xyz = [0, 1, 2].map((axis) => pinned.corners.reduce((sum, corner, k) => sum + pinned.weights[k] * priorPlaces[3 * corner + axis], 0));
  return { place: xyz };
}

function moveSurface({ box, positions, fields }) {
  const [{ geometry, mesh }] = panels;
  const position = geometry.getAttribute("position");
  position.array.set(unpackPositions(positions, box));
  position.needsUpdate = true;
  geometry.computeVertexNormals();
  geometry.boundingSphere = geometry.boundingBox = null; // of where it was
  const known = Object.assign(scene.meshes[mesh].fields, fields);
  setAttribute(geometry, "remoteness", known[scene.remoteness]);
  if (settings.field) {
    setAttribute(geometry, "value", known[settings.field.key]);
    softenMissing(geometry);
  }
  if (pinned?.corners) followPinned(pinned, position);
  if ($("cut").value !== "") cut();
  clearTimeout(shownNow.drawing);
  shownNow.drawing = 0;
  invalidate();
  tellSoon();
}

function drawSoon() {
  shownNow.drawing ||= setTimeout(() => {
    shownNow.drawing = 0;
    invalidate();
  }, DRAW_AFTER);
}

// What is written beside the picture may come a little after it.
function tellSoon() {
  shownNow.telling ||= setTimeout(() => {
    shownNow.telling = 0;
    markBars();
    refreshReadout();
  }, TELL_AFTER);
}

// The ring stays on its place of the wall.
function followPinned({ at, corners, weights }, position) {
  at.set(0, 0, 0);
  corners.forEach((corner, k) => at.addScaledVector(new THREE.Vector3().fromBufferAttribute(position, corner), weights[k]));
}

// A scene with the same faces and fields moves the surface that is there; of another one nothing is taken.
function takeScene(given) {
  const [{ mesh }] = panels;
  const [old, now] = [scene.meshes[mesh], given.meshes[0]];
  const [keys, others] = [scene, given].map(({ fields }) => fields.map(({ key }) => key).join());
  if (keys !== others || scene.arrays[old.faces] !== given.arrays[now.faces]) return false;
  const text = (place) => given.arrays[place];
  const fields = Object.fromEntries(Object.entries(now.fields).map(([key, one]) => [key, { ...one, data: text(one.data) }]));
  scene.box = given.box;
  Object.assign(scene, { centre: given.centre, radius: given.radius });
  moveSurface({ box: given.box, positions: text(now.positions), fields });
  const { x, y, z } = target;
  frameSurfaces();
  target.set(x, y, z); // the picture does not jump under the eyes
  return true;
}

// All points: {id, xyz, type, values, weight, distance}.
function showPoints(points, newest) {
  Object.assign(shownNow, { points, newest: points.find(({ id }) => id === newest) });
  const floats = (of) => Float32Array.from(points, (one) => of(one) ?? MISSING);
  const numbers = new Set(points.flatMap(({ values }) => Object.keys(values ?? {}).filter((key) => typeof values[key] === "number")));
  Object.assign(cloud, {
    positions: Float32Array.from(points.flatMap(({ xyz }) => xyz)),
    kinds: Uint8Array.from(points, ({ type }) => Math.max(0, scene.points.names.indexOf(type))),
    values: Object.fromEntries([...numbers].map((key) => [key, floats(({ values }) => (typeof values?.[key] === "number" ? values[key] : null))])),
    residuals: [floats(({ distance }) => distance)],
    beliefs: [floats(({ weight }) => weight)],
    outliers: [Uint8Array.from(points, ({ type, weight }) => Number(type === "outlier" || (weight ?? 1) < 0.5))],
    rows: Uint32Array.from(points, ({ id }) => id - 1),
  });
  scene.points.ids = points.map(({ id }) => String(id));
  if (shownNow.pinnedId !== null) repin();
  $("point-bar").hidden = Boolean(ownValues(settings.field)) || !points.length;
  paintAllPoints(drawSoon);
  if ($("worst").open) listWorst();
  $("worst").hidden = !points.some(({ distance }) => distance !== null && distance !== undefined);
  refreshReadout();
}

// The ring stays on its point, as long as there is one.
function repin() {
  const point = shownNow.points.findIndex(({ id }) => id === shownNow.pinnedId);
  pinned = point < 0 ? null : { panel: panels[0], point, at: placeOf(point) };
  if (point < 0) shownNow.pinnedId = null;
}

function pinPoint(id) {
  const point = shownNow.points.findIndex((one) => one.id === id);
  if (point >= 0) pin({ panel: panels[0], point, at: placeOf(point) });
}

// The place of the wall in the middle of the picture: for those who turn it by keys.
function pinMiddle() {
  const box = panels[0].canvas.getBoundingClientRect();
  const found = hitSurface(panels[0], rayAt(panels[0], { clientX: box.left + box.width / 2, clientY: box.top + box.height / 2 }));
  if (found) pin({ panel: panels[0], geometry: panels[0].geometry, ...found });
  return Boolean(found);
}

function showLandmarks(landmarks) {
  scene.landmarks = landmarks.filter(({ at }) => at);
  panels.forEach((panel) => { panel.hidden = null; });
  $("labels").parentElement.hidden = !scene.landmarks.length;
  drawSoon();
}

function showNext(places) {
  scene.next = places.map(({ xyz }, k) => ({ name: String(k + 1), at: xyz }));
  panels.forEach((panel) => { panel.hidden = null; });
  drawSoon();
}

function showTip(xyz) {
  if (JSON.stringify(xyz) === JSON.stringify(shownNow.tip)) return;
  shownNow.tip = xyz;
  invalidate();
}

function drawNewest(context, width, height, ratio, ink) {
  if (!shownNow.newest) return;
  const [x, y] = project(...shownNow.newest.xyz, width, height);
  drawRing(context, [x, y], 12, ratio, ink);
  drawTag(context, `newest: ${shownNow.newest.id}`, x, y - 22 * ratio, ratio, ink);
}

function drawTip(context, width, height, ratio, ink) {
  if (!shownNow.tip) return;
  const [x, y] = project(...shownNow.tip, width, height);
  context.strokeStyle = ink;
  context.lineWidth = 2 * ratio;
  context.beginPath();
  for (const [across, down] of [[TIP, 0], [0, TIP]]) {
    context.moveTo(x - across * ratio, y - down * ratio);
    context.lineTo(x + across * ratio, y + down * ratio);
  }
  context.stroke();
  drawTag(context, "tip", x + 20 * ratio, y, ratio, ink);
}

const live = { moveSurface, takeScene, showPoints, showLandmarks, showNext, showTip, pinPoint, pinMiddle };
$("worst").addEventListener("toggle", listWorst);
