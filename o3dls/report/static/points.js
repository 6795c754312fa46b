// Measured points: balls (fitted), cubes (ablation) and diamonds (judged outliers), coloured by their distance to the panel's surface.

const cloud = {
  positions: unpackPositions(scene.points.positions),
  kinds: bytes(scene.points.kinds), // index into scene.points.names
  residuals: scene.panels.map((panel) => unpack(panel.residuals)),
  outliers: scene.panels.map((panel) => bytes(panel.outliers)),
};
const OUTLIER = [0.8, 0.2, 0.6];
const SLAB = 3; // mm beside the cut within which points stay

const many = cloud.kinds.length > 2000; // then smaller and coarser balls
const size = many ? 0.6 : 1.0;
const shapes = {
  ball: new THREE.IcosahedronGeometry(size, many ? 0 : 2),
  cube: new THREE.BoxGeometry(1.7 * size, 1.7 * size, 1.7 * size),
  diamond: new THREE.OctahedronGeometry(1.5 * size),
};

function paintPoints(panel, settings) {
  for (const mesh of panel.balls) {
    panel.world.remove(mesh);
    mesh.dispose();
  }
  const rows = { ball: [], cube: [], diamond: [] };
  for (let i = 0; i < cloud.kinds.length; i++) {
    const kind = scene.points.names[cloud.kinds[i]];
    const outlier = cloud.outliers[panel.index][i] === 1;
    if (!settings.kinds[kind] || !beside(i)) continue;
    if (outlier && !settings.kinds.outliers) continue;
    rows[outlier ? "diamond" : kind === "ablation" ? "cube" : "ball"].push(i);
  }
  panel.balls = Object.entries(rows).filter(([, list]) => list.length).map(([shape, list]) => instances(panel, settings, shape, list));
  panel.balls.forEach((mesh) => panel.world.add(mesh));
}

function beside(i) {
  const { x, y, z, w } = shared.plane.value;
  const height = x * cloud.positions[3 * i] + y * cloud.positions[3 * i + 1] + z * cloud.positions[3 * i + 2] - w;
  return (x === 0 && y === 0 && z === 0) || Math.abs(height) < SLAB;
}

function instances(panel, settings, shape, rows) {
  const geometry = shapes[shape].clone();
  const tint = new Float32Array(3 * rows.length);
  const mesh = new THREE.InstancedMesh(geometry, ballMaterial, rows.length);
  const place = new THREE.Matrix4();
  rows.forEach((i, k) => {
    mesh.setMatrixAt(k, place.makeTranslation(...cloud.positions.subarray(3 * i, 3 * i + 3)));
    tint.set(shape === "diamond" ? OUTLIER : colourOf("points", cloud.residuals[panel.index][i], ...settings.pointRange), 3 * k);
  });
  geometry.setAttribute("tint", new THREE.InstancedBufferAttribute(tint, 3));
  mesh.frustumCulled = false;
  return mesh;
}
