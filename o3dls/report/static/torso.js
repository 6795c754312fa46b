// A small torso that turns with the pictures: from where one looks at the patient. Ellipsoids, painted from back to front.

const PARTS = [ // centre and half axes along the patient's left, front and up
  { kind: "body", at: [0, 0, 2], half: [11, 7, 13] },
  { kind: "body", at: [0, 0, -14], half: [9, 6, 9] },
  { kind: "body", at: [14, 0, -1], half: [3, 3, 13] },
  { kind: "body", at: [-14, 0, -1], half: [3, 3, 13] },
  { kind: "body", at: [0, 0, 22], half: [5.5, 6.5, 7.5] },
  { kind: "nose", at: [0, 7, 21], half: [1.4, 2, 2] },
  { kind: "heart", at: [2.5, 6, 3], half: [3.5, 3, 3.5] },
];
const SIDE = [21, 0, 2]; // where the letter of the left side stands

function drawTorso() {
  if (!scene.patient) return;
  const axes = ["left", "front", "up"].map((name) => new THREE.Vector3(...scene.patient[name]).applyQuaternion(camera.quaternion.clone().invert()));
  const seen = (at) => axes.reduce((sum, axis, k) => sum.addScaledVector(axis, at[k]), new THREE.Vector3());
  const parts = PARTS.map((part) => ({ ...part, centre: seen(part.at) })).sort((a, b) => a.centre.z - b.centre.z);
  const letter = svgElement("text");
  const side = seen(SIDE);
  Object.entries({ x: side.x, y: -side.y, "text-anchor": "middle", "dominant-baseline": "central" }).forEach(([key, value]) => letter.setAttribute(key, value));
  letter.textContent = "L";
  $("torso").replaceChildren(...parts.map(({ kind, centre, half }) => ellipse(kind, centre, axes, half)), letter);
}

// The outline of an ellipsoid, seen along z: an ellipse whose axes are those of the 2 x 2 matrix (a b; b c).
function ellipse(kind, centre, axes, half) {
  const sum = (of) => axes.reduce((total, axis, k) => total + of(axis) * half[k] ** 2, 0);
  const [a, b, c] = [sum((v) => v.x * v.x), sum((v) => v.x * v.y), sum((v) => v.y * v.y)];
  const [middle, spread] = [(a + c) / 2, Math.hypot((a - c) / 2, b)];
  const made = svgElement("ellipse");
  made.setAttribute("rx", Math.sqrt(middle + spread));
  made.setAttribute("ry", Math.sqrt(Math.max(middle - spread, 0)));
  const degrees = (-90 / Math.PI) * Math.atan2(2 * b, a - c); // y of a picture points down
  made.setAttribute("transform", `translate(${centre.x} ${-centre.y}) rotate(${degrees})`);
  made.setAttribute("class", kind);
  return made;
}

// The standard view that the camera has, if it has one: what is on the right tells views along the body apart.
function activeView() {
  const from = camera.position.clone().sub(target).normalize();
  const right = new THREE.Vector3(1, 0, 0).applyQuaternion(camera.quaternion);
  return scene.views.find((view) => {
    const wanted = new THREE.Vector3(...view.from).normalize();
    return wanted.dot(from) > 0.99999 && camera.up.clone().cross(wanted).normalize().dot(right) > 0.999;
  });
}

function showView() {
  const active = activeView();
  const name = active ? active.name : "turned freely";
  if ($("view-name").textContent !== name) $("view-name").textContent = name;
  for (const made of $("views").children) made.setAttribute("aria-pressed", String(made.textContent === name));
  drawTorso();
}
