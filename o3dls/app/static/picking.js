// What the app asks of the report's viewer: which place or point is pinned, and that the prior be shown in another pose. Runs in the viewer's scope.

const told = { pick: () => {}, moved: () => {}, pairs: [] };
const posed = { T: read("app").T, own: null, hand: "", from: null }; // own: corners of the prior in its own frame; hand: what the mouse does to it
const HAND_STEP = { move: 5, turn: Math.PI / 36 }; // mm and radians of a button
const MOST_GAPS = 4e7; // pairs of points and corners that are compared; of more corners every so manieth

host.addEventListener("pin", () => {
  if (pinned) told.pick({ kind: pinned.point === undefined ? "prior" : "map", at: pinned.at.toArray() });
});

// The place of the prior, or the point, in the middle of the picture: for those who turn it by keys.
function pinMiddle() {
  const [panel] = panels;
  const box = panel.canvas.getBoundingClientRect();
  pin(hit(panel, { clientX: box.left + box.width / 2, clientY: box.top + box.height / 2 }));
  return Boolean(pinned);
}

const matrixOf = (T) => new THREE.Matrix4().set(...T.flat());
const rowsOf = ({ elements }) => [0, 1, 2, 3].map((row) => [0, 1, 2, 3].map((column) => elements[4 * column + row]));

// The corners are written anew, since clicks are compared with them.
function showAt(T) {
  const { geometry } = panels[0];
  const position = geometry.getAttribute("position");
  position.array.set(cornersAt(T));
  position.needsUpdate = true;
  geometry.computeVertexNormals();
  geometry.boundingSphere = null;
  posed.T = T;
  if (pinned) pin(null);
  invalidate();
}

// The corners of the prior (3n) in a pose.
function cornersAt(T) {
  const [{ geometry }] = panels;
  posed.own ??= geometry.getAttribute("position").clone().applyMatrix4(matrixOf(posed.T).invert());
  return posed.own.clone().applyMatrix4(matrixOf(T)).array;
}

// Colour the points by their distance to the corners of the prior in a pose; half of the mapping points are nearer than what is returned.
function measureGaps(T) {
  const corners = cornersAt(T);
  const [distances] = cloud.residuals;
  const skip = 3 * Math.ceil((distances.length * corners.length) / 3 / MOST_GAPS);
  for (let i = 0; i < distances.length; i++) {
    const [x, y, z] = cloud.positions.subarray(3 * i, 3 * i + 3);
    let nearest = Infinity;
    for (let k = 0; k < corners.length; k += skip) nearest = Math.min(nearest, (corners[k] - x) ** 2 + (corners[k + 1] - y) ** 2 + (corners[k + 2] - z) ** 2);
    distances[i] = Math.sqrt(nearest);
  }
  paintAllPoints();
  const mapped = [...distances].filter((_, i) => kindOf(i) === "eam").sort((one, other) => one - other);
  return mapped[Math.floor(mapped.length / 2)];
}

// What is shown fills the picture again, seen from where it was seen.
function reframe() {
  const from = camera.position.clone().sub(target);
  frameSurfaces();
  camera.position.copy(target).add(from);
  camera.zoom = 1;
  invalidate();
}

// The motion of the prior by steps to the right, upwards and around these, as the picture is seen.
function moveByHand(kind, across, along, around = 0) {
  const { right, up } = sidesOf(camera.position.clone().sub(target).normalize());
  const towards = new THREE.Vector3().crossVectors(right, up);
  panels[0].geometry.computeBoundingSphere();
  const middle = panels[0].geometry.boundingSphere.center.clone();
  const shift = right.clone().multiplyScalar(across).addScaledVector(up, along).addScaledVector(towards, around);
  const turn = new THREE.Matrix4().makeTranslation(...middle.toArray());
  for (const [axis, angle] of [[up, across], [right, -along], [towards, around]]) turn.multiply(new THREE.Matrix4().makeRotationAxis(axis, angle));
  turn.multiply(new THREE.Matrix4().makeTranslation(...middle.negate().toArray()));
  const step = kind === "move" ? new THREE.Matrix4().makeTranslation(...shift.toArray()) : turn;
  showAt(rowsOf(step.multiply(matrixOf(posed.T))));
}

// Before the viewer hears of it: the same movement of the mouse must not turn the view too.
function takeMouse(event) {
  const { canvas } = panels[0];
  if (!posed.hand || event.target !== canvas) return;
  event.stopPropagation();
  if (event.type === "pointerdown") {
    canvas.setPointerCapture(event.pointerId);
    posed.from = event;
  } else if (event.type === "pointermove" && posed.from) {
    const [x, y] = [event.clientX - posed.from.clientX, posed.from.clientY - event.clientY];
    const each = posed.hand === "move" ? host.dataset.tall / canvas.clientHeight : Math.PI / canvas.clientHeight;
    moveByHand(posed.hand, x * each, y * each);
    posed.from = event;
  } else if (event.type === "pointerup" && posed.from) {
    posed.from = null;
    told.moved(posed.T);
  }
}
for (const kind of ["pointerdown", "pointermove", "pointerup", "click"]) host.addEventListener(kind, takeMouse, true);

// Both places of each pair, by its number.
function drawPairs(context, width, height, ratio, ink) {
  const move = matrixOf(posed.T);
  told.pairs.forEach(({ prior, map }, k) => {
    const places = [prior && new THREE.Vector3(...prior).applyMatrix4(move).toArray(), map].filter(Boolean);
    for (const at of places) {
      const [x, y] = project(...at, width, height);
      drawRing(context, [x, y], 7, ratio, ink);
      context.fillStyle = ink;
      context.font = `bold ${14 * ratio}px system-ui, sans-serif`;
      context.fillText(k + 1, x + 9 * ratio, y - 7 * ratio);
    }
  });
}
overlays.push(drawPairs);

const picking = {
  showPairs: (pairs) => { told.pairs = pairs; invalidate(); },
  onPick: (pick) => { told.pick = pick; },
  onMoved: (moved) => { told.moved = moved; },
  pinMiddle,
  showAt,
  measureGaps,
  reframe,
  takeHand: (hand) => { posed.hand = hand; },
  step: (kind, across, along, around) => {
    moveByHand(kind, ...[across, along, around].map((one) => one * HAND_STEP[kind]));
    told.moved(posed.T);
  },
};
