// The plane of the cut: across an axis, or free, across the direction from which one looked when it was chosen.

const NO_PLANE = new THREE.Vector4(0, 0, 0, 1);
const freeNormal = new THREE.Vector3(...scene.views[0].from).normalize();

function connectPlane() {
  option($("cut"), "free", "free");
  $("cut").addEventListener("change", () => ($("cut").value === "free" ? takeDirection() : cut()));
  $("cut-turn").addEventListener("click", takeDirection);
}

function takeDirection() {
  freeNormal.copy(camera.position).sub(target).normalize();
  cut();
}

// Its normal, towards what is cut away, and its height along that; null: nothing is cut.
function cutPlane() {
  const choice = $("cut").value;
  if (choice === "") return null;
  const free = choice === "free";
  const along = free ? freeNormal : new THREE.Vector3().setComponent(Number(choice), 1);
  const sign = free ? 1 : scene.cutSigns[Number(choice)];
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
