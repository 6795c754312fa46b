// Measured points: balls (fitted; grey those inside), cubes (ablation) and diamonds (judged outliers), coloured by their own value where the chosen field was measured, else by their distance to the panel's surface.

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

const FEW = 100, MANY = 2000; // more points have coarser balls, and many smaller ones
const [smooth, fine, coarse] = [makeShapes(1.2, 2), makeShapes(1.2, 1), makeShapes(0.7, 0)];
const shapesNow = () => (cloud.kinds.length > MANY ? coarse : cloud.kinds.length > FEW ? fine : smooth);

function makeShapes(size, detail) {
  return {
    size,
    ball: { geometry: new THREE.IcosahedronGeometry(size, detail), material: ballMaterial(0.76 * size) },
    cube: { geometry: new THREE.BoxGeometry(1.6 * size, 1.6 * size, 1.6 * size), material: ballMaterial(0.8 * size) },
    diamond: { geometry: new THREE.OctahedronGeometry(1.4 * size), material: ballMaterial(0.9 * size) },
  };
}

function paintPoints(panel, settings) {
  for (const mesh of panel.balls) {
    panel.world.remove(mesh);
    mesh.geometry.dispose();
    mesh.dispose();
  }
  const rows = { ball: [], cube: [], diamond: [] };
  for (let i = 0; i < cloud.kinds.length; i++) {
    const kind = scene.points.names[cloud.kinds[i]];
    const outlier = cloud.outliers[panel.estimate][i] === 1;
    if (!settings.kinds[kind] || !beside(i)) continue;
    if (outlier && !settings.kinds.outliers) continue;
    rows[outlier ? "diamond" : kind === "ablation" ? "cube" : "ball"].push(i);
  }
  panel.rows = Object.values(rows).flat();
  panel.balls = Object.entries(rows).filter(([, list]) => list.length).map(([shape, list]) => instances(panel, settings, shape, list));
  panel.balls.forEach((mesh) => panel.world.add(mesh));
}

function beside(i) {
  const { x, y, z, w } = shared.plane.value;
  const height = x * cloud.positions[3 * i] + y * cloud.positions[3 * i + 1] + z * cloud.positions[3 * i + 2] - w;
  return (x === 0 && y === 0 && z === 0) || Math.abs(height) < SLAB;
}

function instances(panel, settings, shape, rows) {
  const { geometry: form, material } = shapesNow()[shape];
  const geometry = form.clone();
  const tint = new Float32Array(3 * rows.length);
  const mesh = new THREE.InstancedMesh(geometry, material, rows.length);
  const place = new THREE.Matrix4();
  rows.forEach((i, k) => {
    mesh.setMatrixAt(k, place.makeTranslation(...cloud.positions.subarray(3 * i, 3 * i + 3)));
    tint.set(shape === "diamond" ? OUTLIER : pointColour(panel, settings, i), 3 * k);
  });
  geometry.setAttribute("tint", new THREE.InstancedBufferAttribute(tint, 3));
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
