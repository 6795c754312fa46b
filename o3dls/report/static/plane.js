// The plane of the cut: across an axis, or free, across the direction from which one looked when it was chosen.

const NO_PLANE = new THREE.Vector4(0, 0, 0, 1);
let flipped = false; // the other side of the plane is taken away
const freeNormal = new THREE.Vector3(...scene.views[0].from).normalize();

function connectPlane() {
  option($("cut"), "free", "free");
  $("cut").addEventListener("change", () => {
    flipped = false;
    if ($("cut").value === "free") takeDirection();
    else faceCut();
  });
  $("cut-turn").addEventListener("click", takeDirection);
  $("cut-flip").addEventListener("click", () => { flipped = !flipped; faceCut(); });
}

// Cuts, and looks at what the cut opens.
function faceCut() {
  const plane = cutPlane();
  cut();
  if (!plane) return;
  const from = new THREE.Vector3(plane.x, plane.y, plane.z);
  const along = scene.views.find((view) => new THREE.Vector3(...view.from).normalize().dot(from) > 0.99999);
  lookFrom(along ? along.from : from.toArray()); // a view is tilted a little where it looks along the body
  keepWhole();
}

function takeDirection() {
  flipped = false;
  freeNormal.copy(camera.position).sub(target).normalize();
  cut();
}

// Its normal, towards what is cut away, and its height along that; null: nothing is cut.
function cutPlane() {
  const choice = $("cut").value;
  if (choice === "") return null;
  const free = choice === "free";
  const along = free ? freeNormal : new THREE.Vector3().setComponent(Number(choice), 1);
  const sign = (free ? 1 : scene.cutSigns[Number(choice)]) * (flipped ? -1 : 1);
  const [low, high] = heightsOfBox(along);
  const level = low + (high - low) * Number($("level").value);
  return new THREE.Vector4(sign * along.x, sign * along.y, sign * along.z, sign * level);
}

function heightsOfBox(along) {
  const { low, size } = scene.box;
  const reach = along.toArray().map((a, k) => [a * low[k], a * (low[k] + size[k])]);
  return [Math.min, Math.max].map((end) => reach.reduce((sum, ends) => sum + end(...ends), 0));
}

// Whether the plane has taken a place away.
function isCut({ x, y, z }) {
  const plane = shared.plane.value;
  return plane.x * x + plane.y * y + plane.z * z > plane.w;
}
