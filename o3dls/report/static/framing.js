// How much of a picture the surfaces fill: those that the page opens with, from the side from which it opens.

const FILLED = 0.8, WHOLE = 0.97; // shares of the width or the height of a picture
let frame = { wide: scene.radius, tall: scene.radius }; // half of what the surfaces take

// The camera's target goes into their middle.
function frameSurfaces() {
  const opened = scene.panels.map((k) => placesOf(geometryOf(scene.estimates[k].mesh)));
  if (scene.framesPoints) opened.push(cloud.positions); // where the surface may stand beside them
  const { right, up } = sidesOf(new THREE.Vector3(...scene.views[0].from).normalize());
  target.set(...scene.centre);
  const across = spanAlong(opened, right), along = spanAlong(opened, up);
  frame = { wide: (across.high - across.low) / 2, tall: (along.high - along.low) / 2 };
  target.addScaledVector(right, (across.high + across.low) / 2).addScaledVector(up, (along.high + along.low) / 2);
}

// What lies to the right and above, seen from a direction.
function sidesOf(from) {
  const right = new THREE.Vector3().crossVectors(camera.up, from).normalize();
  return { right, up: new THREE.Vector3().crossVectors(from, right) };
}

const placesOf = (geometry) => geometry.getAttribute("position").array;

// How far arrays of places reach from the target along a direction.
function spanAlong(places, { x, y, z }) {
  let [low, high] = [Infinity, -Infinity];
  for (const array of places) {
    for (let i = 0; i < array.length; i += 3) {
      const at = x * (array[i] - target.x) + y * (array[i + 1] - target.y) + z * (array[i + 2] - target.z);
      if (at < low) low = at;
      if (at > high) high = at;
    }
  }
  return { low, high };
}

// Zooms out where a surface that is shown reaches beyond its picture.
function keepWhole() {
  const shown = panels.filter((panel) => panel.shown);
  const { clientWidth, clientHeight } = shown[0]?.canvas ?? {};
  if (!clientHeight) return;
  const { right, up } = sidesOf(camera.position.clone().sub(target).normalize());
  const reach = (direction) => {
    const { low, high } = spanAlong(shown.map(({ geometry }) => placesOf(geometry)), direction);
    return Math.max(-low, high);
  };
  const aspect = clientWidth / clientHeight;
  const half = Math.max(frame.tall, frame.wide / aspect) / FILLED;
  camera.zoom = Math.min(camera.zoom, (WHOLE * half) / Math.max(reach(up), reach(right) / aspect));
  invalidate();
}
