// What a panel shows at a place of its canvas: one ray along the view, against its triangles and its points.

function rayAt({ canvas }, { clientX, clientY }) {
  const box = canvas.getBoundingClientRect();
  camera.lookAt(target); // it may have been turned since the picture was drawn
  fitCamera(box.width / box.height);
  const x = (2 * (clientX - box.left)) / box.width - 1;
  const y = 1 - (2 * (clientY - box.top)) / box.height;
  const [right, up, back] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => new THREE.Vector3(...axis).applyQuaternion(camera.quaternion));
  return { origin: new THREE.Vector3(x, y, -1).unproject(camera), right, up, forward: back.negate() };
}

// Of positions, how far they are to the right of the ray and above it.
function besideRay(at, { origin, right, up }) {
  const out = new Float64Array((at.length / 3) * 2);
  const [u, v] = [origin.dot(right), origin.dot(up)];
  for (let i = 0, k = 0; i < at.length; i += 3, k += 2) {
    out[k] = right.x * at[i] + right.y * at[i + 1] + right.z * at[i + 2] - u;
    out[k + 1] = up.x * at[i] + up.y * at[i + 1] + up.z * at[i + 2] - v;
  }
  return out;
}

// The nearest place of the surface that is neither cut away nor behind the cap of the cut: {at, corners, weights, depth}, or null.
function hitSurface({ geometry }, ray) {
  const position = geometry.getAttribute("position");
  const index = geometry.index.array;
  const flat = besideRay(position.array, ray);
  const cross = (a, b) => flat[2 * a] * flat[2 * b + 1] - flat[2 * a + 1] * flat[2 * b];
  let [nearest, taken] = [null, 0];
  for (let f = 0; f < index.length; f += 3) {
    const [a, b, c] = [index[f], index[f + 1], index[f + 2]];
    const [wa, wb, wc] = [cross(b, c), cross(c, a), cross(a, b)]; // twice the areas beside the ray
    const area = wa + wb + wc;
    if (area === 0 || wa * area < 0 || wb * area < 0 || wc * area < 0) continue;
    const [corners, weights] = [[a, b, c], [wa / area, wb / area, wc / area]];
    const at = new THREE.Vector3();
    corners.forEach((corner, k) => at.addScaledVector(new THREE.Vector3().fromBufferAttribute(position, corner), weights[k]));
    const depth = at.clone().sub(ray.origin).dot(ray.forward);
    if (isCut(at)) taken += 1;
    else if (!(nearest && nearest.depth < depth)) nearest = { at, corners, weights, depth };
  }
  return isCapped(ray, taken) ? null : nearest;
}

const BESIDE = 1.3 * RADIUS; // pixels: a little beside a small point still means it
const FINGER = 12; // pixels: a finger means what is nearest to it within a target of 24

// The drawn point under the ray that the wall, at a depth, does not hide: of a mouse the one in front, of a finger the nearest to it; undefined where there is none.
function hitPoint(panel, ray, depth, finger) {
  const reach = ((finger ? FINGER : BESIDE) * (camera.top - camera.bottom)) / (camera.zoom * panel.canvas.clientHeight);
  const flat = besideRay(cloud.positions, ray);
  const depthOf = (i) => placeOf(i).sub(ray.origin).dot(ray.forward);
  const away = (i) => Math.hypot(flat[2 * i], flat[2 * i + 1]);
  const first = finger ? away : depthOf;
  return panel.rows
    .filter((i) => away(i) < reach && rankOf(panel, i) <= panel.share && depthOf(i) - marks.lift.value < depth)
    .sort((i, j) => first(i) - first(j))[0];
}

const placeOf = (i) => new THREE.Vector3(...cloud.positions.subarray(3 * i, 3 * i + 3));

// {panel, at} with the point, or with the triangle of the surface; null beside everything.
function hit(panel, event) {
  const ray = rayAt(panel, event);
  const wall = hitSurface(panel, ray);
  const point = hitPoint(panel, ray, wall && shared.opacity.value === 1 ? wall.depth : Infinity, event.pointerType === "touch");
  if (point !== undefined) return { panel, point, at: placeOf(point) };
  return wall && { panel, geometry: panel.geometry, ...wall };
}
