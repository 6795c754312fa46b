// Landmarks, doubtful regions and proposed places behind the wall: found by one ray each when the camera has come to rest, and then written faintly.

const FREE = 2; // mm of wall that do not hide a place: it lies on the wall itself
const REST = 150; // ms without a new picture
let resting = 0;

function findHidden() {
  clearTimeout(resting);
  const marks = settings.labels ? scene.landmarks : [];
  const next = settings.next ? scene.next : [];
  const doubts = settings.doubts ? scene.doubts : [];
  if (!marks.length && !next.length && !doubts.length) return;
  resting = setTimeout(() => {
    const changed = panels.filter((panel) => panel.shown).map((panel) => {
      const found = { marks: marks.map(({ at }) => hides(panel, at)), next: next.map(({ at }) => hides(panel, at)), doubts: doubts.map((_, k) => hides(panel, onWall(panel, k))) };
      const same = panel.hidden && JSON.stringify(found) === JSON.stringify(panel.hidden);
      panel.hidden = found;
      return !same;
    });
    if (changed.includes(true)) invalidate();
  }, REST);
}

// Whether a panel's surface, less what is cut away, or the cap of its cut stands between a place and the camera.
function hides({ sides }, at) {
  const direction = camera.position.clone().sub(target).normalize();
  const ray = { origin: new THREE.Vector3(...at), direction };
  const hits = [];
  for (const side of sides) side.raycast({ ray, near: FREE, far: Infinity }, hits);
  const plane = shared.plane.value;
  const kept = ({ x, y, z }) => plane.x * x + plane.y * y + plane.z * z <= plane.w;
  const taken = hits.filter(({ object, point }) => object === sides[1] && !kept(point)).length; // which has both sides where a cap may be
  return hits.some(({ point }) => kept(point)) || (kept(ray.origin) && isCapped({ forward: direction.clone().negate() }, taken));
}
