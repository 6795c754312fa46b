// The pictures: one panel per estimate, one camera, one renderer that paints all panels in turn.

const host = document.getElementById("panels");
const renderer = makeRenderer();
const camera = new THREE.OrthographicCamera(-1, 1, 1, -1, -4000, 4000);
const target = new THREE.Vector3(...scene.centre);
camera.up.set(...scene.up);

const OUTLINE = 3; // pixels of the screen
const geometries = []; // of scene.meshes, decoded when first shown
const panels = scene.panels.map(makePanel);
let waiting = false;

function makeRenderer() {
  const made = new THREE.WebGLRenderer({ canvas: webgl.canvas, context: webgl, alpha: true });
  made.outputColorSpace = THREE.LinearSRGBColorSpace; // colours on the screen are those of the colour bar
  made.setClearColor(0x000000, 0);
  return made;
}

function geometryOf(mesh) {
  if (!geometries[mesh]) {
    geometries[mesh] = decodeMesh(scene.meshes[mesh]);
    setAttribute(geometries[mesh], "remoteness", scene.meshes[mesh].fields[scene.remoteness]);
  }
  return geometries[mesh];
}

function makePanel(estimate, index) {
  const figure = document.createElement("figure");
  const caption = document.createElement("figcaption");
  const canvas = document.createElement("canvas");
  canvas.tabIndex = 0;
  canvas.setAttribute("role", "img");
  figure.append(caption, canvas);
  host.append(figure);
  const note = document.createElement("small");

  const world = new THREE.Scene();
  const sides = [THREE.BackSide, THREE.FrontSide].map((side) => new THREE.Mesh(geometryOf(scene.estimates[estimate].mesh), surfaceMaterial(side)));
  sides.forEach((mesh) => world.add(mesh));
  const ghosts = Object.fromEntries(Object.entries(scene.estimates[estimate].ghosts).map(([name, ghost]) => [name, makeGhost(ghost, world, scene.ghostStyles[name].colour)]));
  const panel = { index, figure, canvas, note, world, sides, ghosts, marks: [], rows: [], share: 1, shown: true };
  setEstimate(panel, estimate);
  caption.append(estimateSelect(panel), note);
  makeCube(panel);
  connect(panel);
  return panel;
}

// A translucent body with an outline in the colour that its contour has in a cut.
function makeGhost({ mesh }, world, colour) {
  const own = { mapped: { value: false }, hatched: { value: false }, opacity: { value: 0.12 }, outline: { value: new THREE.Vector3() }, outlined: { value: OUTLINE }, plain: { value: new THREE.Vector3(0.45, 0.5, 0.6) } };
  const ghost = new THREE.Mesh(geometryOf(mesh), surfaceMaterial(THREE.FrontSide, own));
  ghost.material.transparent = true;
  ghost.material.depthWrite = false;
  ghost.matrixAutoUpdate = false;
  ghost.visible = false;
  ghost.onBeforeRender = () => { // light and dark differ
    own.outline.value.set(...pageColour(colour));
    own.outlined.value = OUTLINE * pixelRatio();
  };
  world.add(ghost);
  return ghost;
}

// A colour variable of the page, #rrggbb, as [r, g, b] in 0..1.
function pageColour(name) {
  const hex = parseInt(getComputedStyle(document.documentElement).getPropertyValue(name).trim().slice(1), 16);
  return [16, 8, 0].map((shift) => ((hex >> shift) & 255) / 255);
}

// Mouse, touch and keys of a panel move the one camera.
function connect(panel) {
  const controls = new THREE.OrbitControls(camera, panel.canvas);
  controls.target = target;
  controls.addEventListener("change", invalidate);
  shareWithPage(panel.canvas, controls);
  panel.canvas.addEventListener("keydown", (event) => {
    const turn = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const zoom = { "+": 1.2, "=": 1.2, "-": 1 / 1.2 }[event.key];
    if (turn) rotate(...turn.map((step) => (step * Math.PI) / 18));
    else if (zoom) camera.zoom *= zoom;
    else if (event.key === "0") resetView();
    else return;
    event.preventDefault();
    invalidate();
  });
}

function rotate(around, over) {
  const offset = camera.position.clone().sub(target);
  const right = new THREE.Vector3().crossVectors(camera.up, offset).normalize();
  const tilt = offset.angleTo(camera.up) + over;
  offset.applyAxisAngle(camera.up, around);
  if (tilt > 0.02 && tilt < Math.PI - 0.02) offset.applyAxisAngle(right.applyAxisAngle(camera.up, around), over);
  camera.position.copy(target).add(offset);
}

// Look from a direction of the scene's own axes.
function lookFrom(direction) {
  const from = new THREE.Vector3(...direction).normalize();
  camera.position.copy(target).addScaledVector(from, 1000);
  invalidate();
}

function resetView() {
  frameSurfaces();
  camera.zoom = 1;
  lookFrom(scene.views[0].from);
}

function invalidate() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    drawAll();
  });
}

const pixelRatio = () => Math.min(window.devicePixelRatio || 1, 2);

function sizeOnScreen({ canvas }) {
  const ratio = pixelRatio();
  return { width: Math.round(canvas.clientWidth * ratio), height: Math.round(canvas.clientHeight * ratio), ratio };
}

// `size` gives width, height and pixels per pixel of the screen of a panel's picture.
function drawAll(size = sizeOnScreen) {
  camera.lookAt(target);
  host.dataset.looksFrom = JSON.stringify(camera.position.clone().sub(target).normalize().toArray());
  const shown = panels.filter((panel) => panel.shown);
  for (const panel of shown) {
    const { width, height, ratio } = size(panel);
    if (!width || !height) continue;
    fitCamera(width / height);
    if (renderer.domElement.width !== width || renderer.domElement.height !== height) renderer.setSize(width, height, false);
    sizeMarks(panel, width, height, ratio);
    renderer.render(panel.world, camera);
    panel.calls = renderer.info.render.calls;
    if (panel.canvas.width !== width || panel.canvas.height !== height) Object.assign(panel.canvas, { width, height });
    const context = panel.canvas.getContext("2d");
    context.clearRect(0, 0, width, height);
    context.drawImage(renderer.domElement, 0, 0);
    drawOverlay(panel, context, ratio);
    placeCube(panel);
  }
  document.documentElement.dataset.drawCalls = JSON.stringify(shown.map((panel) => panel.calls));
  noteThinned(shown);
  showView();
  findHidden();
  noteState();
}

function fitCamera(aspect) {
  const half = Math.max(frame.tall, frame.wide / aspect) / FILLED;
  Object.assign(camera, { left: -half * aspect, right: half * aspect, top: half, bottom: -half });
  camera.updateProjectionMatrix();
  camera.updateMatrixWorld();
  host.dataset.tall = (2 * half) / camera.zoom; // height of a picture in the case's unit
}
