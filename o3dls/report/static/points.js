// Measured points: discs (fitted; grey those inside), squares (ablation) and diamonds (judged outliers), coloured by their own value where the chosen field was measured, else by their distance to the panel's surface.

const cloud = {
  positions: unpackPositions(scene.points.positions),
  kinds: bytes(scene.points.kinds), // index into scene.points.names
  values: Object.fromEntries(Object.entries(scene.points.values).map(([key, data]) => [key, unpack(data)])),
  residuals: scene.estimates.map((estimate) => unpack(estimate.residuals)),
  beliefs: scene.estimates.map((estimate) => unpack(estimate.beliefs)),
  outliers: scene.estimates.map((estimate) => bytes(estimate.outliers)),
  rows: uint32(scene.points.rows), // of points.csv, from 0
};
const OUTLIER = [0.8, 0.2, 0.6], INSIDE = [0.55, 0.55, 0.55]; // no wall: their distance from it is no error
const SLAB = 3; // mm beside the cut within which points stay

const FORMS = { disc: 0, square: 1, diamond: 2 };
const RADIUS = 5.5; // pixels of the screen, however far one zooms
const CROWDED = 0.35; // share of a picture that points may cover; where they are more, some of them are drawn
const GOLDEN = 0.6180339887;

function paintPoints(panel, settings) {
  for (const mesh of panel.marks) {
    panel.world.remove(mesh);
    mesh.geometry.dispose();
    mesh.dispose();
  }
  panel.rows = [...cloud.kinds.keys()].filter((i) => settings.kinds[kindOf(i)] && beside(i) && (settings.kinds.outliers || !isOutlier(panel, i)));
  panel.marks = panel.rows.length ? [instances(panel, settings, panel.rows)] : [];
  panel.marks.forEach((mesh) => panel.world.add(mesh));
}

const isOutlier = (panel, i) => cloud.outliers[panel.estimate][i] === 1;
const formOf = (panel, i) => (isOutlier(panel, i) ? FORMS.diamond : kindOf(i) === "ablation" ? FORMS.square : FORMS.disc);

// Spread over the order in which they were taken; an outlier is always drawn.
const rankOf = (panel, i) => (isOutlier(panel, i) ? 0 : (i * GOLDEN) % 1);

// The share of a panel's points that finds room; all of them where one has zoomed in.
function shareOf({ rows }, width, height, ratio) {
  const room = (CROWDED * width * height * camera.zoom ** 2) / (2 * RADIUS * ratio) ** 2;
  return Math.min(1, room / Math.max(rows.length, 1));
}

function sizeMarks(panel, width, height, ratio) {
  marks.screen.value.set(width, height, 0, 0);
  marks.radius.value = RADIUS * ratio;
  marks.share.value = panel.share = shareOf(panel, width, height, ratio);
}

// Says so where not all points are drawn.
function noteThinned(shown) {
  const few = shown.find(({ share }) => share < 1);
  $("thinned").hidden = !few;
  if (few) $("thinned").textContent = `about ${Math.round(few.share * few.rows.length)} of ${few.rows.length} points are drawn: zoom in for more`;
}

function beside(i) {
  const { x, y, z, w } = shared.plane.value;
  const height = x * cloud.positions[3 * i] + y * cloud.positions[3 * i + 1] + z * cloud.positions[3 * i + 2] - w;
  return (x === 0 && y === 0 && z === 0) || Math.abs(height) < SLAB;
}

// A square of two triangles, of which MARK_FRAGMENT cuts the form.
function instances(panel, settings, rows) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(Float32Array.from([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0]), 3));
  geometry.setIndex([0, 1, 2, 0, 2, 3]);
  const mesh = new THREE.InstancedMesh(geometry, markMaterial, rows.length);
  const place = new THREE.Matrix4();
  rows.forEach((i, k) => mesh.setMatrixAt(k, place.makeTranslation(...cloud.positions.subarray(3 * i, 3 * i + 3))));
  const own = (name, size, of) => geometry.setAttribute(name, new THREE.InstancedBufferAttribute(Float32Array.from(rows.flatMap(of)), size));
  own("tint", 3, (i) => (isOutlier(panel, i) ? OUTLIER : [...pointColour(panel, settings, i)]));
  own("form", 1, (i) => formOf(panel, i));
  own("rank", 1, (i) => rankOf(panel, i));
  mesh.frustumCulled = false;
  return mesh;
}

function pointColour(panel, { field, pointRange }, i) {
  const own = ownValues(field);
  if (own) return colourOf(field.map, own[i], ...shared.range.value);
  if (scene.points.names[cloud.kinds[i]] === "inside") return INSIDE;
  return colourOf("points", cloud.residuals[panel.estimate][i], ...pointRange);
}

// What the points themselves measured of a field; undefined where they did not.
function ownValues(field) {
  return field && cloud.values[field.key];
}
