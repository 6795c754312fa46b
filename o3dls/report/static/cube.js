// The orientation cube in a corner of each picture: painted into it, with a button over each face and letter that is seen.

const CUBE = { half: 15, middle: 31, beside: 1.7 }; // pixels of the screen: half an edge, from the corner to the middle; where a letter stands beside
const EDGE_ON = 0.35; // of a face that looks less towards us the letter stands beside the cube

const svgElement = (name) => document.createElementNS("http://www.w3.org/2000/svg", name);

// Each face as the camera sees it, in pixels from the cube's middle, y down. scene.cube has opposite faces in pairs.
function cubeFaces() {
  const turned = camera.quaternion.clone().invert();
  const normals = scene.cube.map(({ view }) => new THREE.Vector3(...fromOf(view)).normalize().applyQuaternion(turned));
  return scene.cube.map((face, k) => {
    const normal = normals[k];
    const [u, v] = [1, 2].map((n) => normals[2 * (((k >> 1) + n) % 3)]);
    const corner = ([a, b]) => normal.clone().addScaledVector(u, a).addScaledVector(v, b);
    const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(corner).map(({ x, y }) => [CUBE.half * x, -CUBE.half * y]);
    const out = CUBE.half * (normal.z < EDGE_ON ? CUBE.beside / Math.hypot(normal.x, normal.y) : 1);
    return { ...face, normal, corners, letterAt: [out * normal.x, -out * normal.y], within: normal.z >= EDGE_ON };
  });
}

const fromOf = (name) => scene.views.find((view) => view.name === name).from;
const isSeen = ({ normal }) => normal.z > -EDGE_ON;

function drawCube(context, height, ratio, ink) {
  context.save();
  context.translate(CUBE.middle * ratio, height - CUBE.middle * ratio);
  context.scale(ratio, ratio);
  context.strokeStyle = context.fillStyle = ink;
  context.lineWidth = 1.2;
  context.textAlign = "center";
  context.textBaseline = "middle";
  for (const { normal, corners, letter, letterAt, within } of cubeFaces().filter(isSeen)) {
    context.globalAlpha = within ? 1 : 0.8;
    if (normal.z > 0.01) drawFace(context, corners, ink);
    context.font = `${within ? 600 : 400} ${letter.length > 1 ? 10 : 12}px system-ui, sans-serif`;
    if (within) context.fillText(letter, ...letterAt);
    else writeOver(context, letter, ...letterAt, 3);
  }
  context.restore();
}

function drawFace(context, corners, ink) {
  context.beginPath();
  corners.forEach((at) => context.lineTo(...at));
  context.closePath();
  context.fillStyle = getComputedStyle(document.body).backgroundColor;
  context.fill();
  context.fillStyle = ink;
  context.stroke();
}

// The buttons: Tab reaches the face that looks at us most, arrow keys turn to the next one.
function makeCube(panel) {
  const { middle } = CUBE;
  panel.cube = svgElement("svg");
  const say = (element, names) => Object.entries(names).forEach(([key, value]) => element.setAttribute(key, value));
  say(panel.cube, { class: "cube", viewBox: [-middle, -middle, 2 * middle, 2 * middle].join(" "), role: "group", "aria-label": "Orientation cube" });
  for (const { letter, view } of scene.cube) {
    const button = svgElement("path");
    say(button, { role: "button", "aria-label": `${letter}: view ${view}` });
    button.addEventListener("click", () => turnTo(view));
    button.addEventListener("keydown", (event) => pressFace(panel, view, event));
    panel.cube.append(button);
  }
  panel.figure.append(panel.cube);
}

function turnTo(view) {
  lookFrom(fromOf(view));
  keepWhole();
}

function pressFace(panel, view, event) {
  const { key } = event;
  const side = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[key];
  if (!side && key !== "Enter" && key !== " ") return;
  event.preventDefault();
  if (!side) return turnTo(view);
  const along = ({ normal }) => side[0] * normal.x + side[1] * normal.y;
  const found = cubeFaces().map(along);
  const next = found.indexOf(Math.max(...found));
  turnTo(scene.cube[next].view);
  const button = panel.cube.children[next];
  button.style.display = ""; // one that is not seen yet cannot have the focus
  button.focus();
}

function placeCube({ canvas, cube }) {
  const faces = cubeFaces();
  const front = Math.max(...faces.map(({ normal }) => normal.z));
  cube.style.top = `${canvas.offsetTop + canvas.offsetHeight - 2 * CUBE.middle}px`;
  cube.style.left = `${canvas.offsetLeft}px`;
  faces.forEach((face, k) => {
    const button = cube.children[k];
    button.style.display = isSeen(face) ? "" : "none";
    button.setAttribute("tabindex", face.normal.z === front ? 0 : -1);
    if (isSeen(face)) button.setAttribute("d", face.within ? `M${face.corners.join("L")}Z` : letterBox(face.letterAt));
  });
}

const letterBox = ([x, y]) => `M${x - 7},${y - 7}h14v14h-14Z`;
