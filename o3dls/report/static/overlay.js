// What is written over the pictures: contours in the cut, names, the cube and a scale bar.

const FAINT = 0.35; // of what is behind the wall
const overlays = []; // what pages with more to show draw over every picture
let contours = []; // of the cut: [{name, colour, dash, segments: Float32Array of x1 y1 z1 x2 y2 z2}]

function project(x, y, z, width, height) {
  const at = new THREE.Vector3(x, y, z).project(camera);
  return [((at.x + 1) * width) / 2, ((1 - at.y) * height) / 2];
}

function drawOverlay(panel, context, ratio) {
  const { width, height } = panel.canvas;
  const ink = getComputedStyle(panel.canvas).color;
  context.lineJoin = context.lineCap = "round";
  drawContours(context, width, height, ratio);
  drawLabels(panel, context, width, height, ratio, ink);
  if (settings.next) for (let k = scene.next.length - 1; k >= 0; k--) drawNumber({ ...scene.next[k], strength: panel.hidden?.next[k] ? FAINT : 1 }, context, width, height, ratio);
  overlays.forEach((draw) => draw(context, width, height, ratio, ink));
  drawPinned(context, width, height, ratio, ink);
  drawMeasured(context, width, height, ratio, ink);
  drawCube(context, height, ratio, ink);
  drawScaleBar(context, width, height, ratio, ink);
}

// Each line over an edge in the page's colour, so that it is clear on wall of any colour; the edges hide no line.
function drawContours(context, width, height, ratio) {
  const edge = getComputedStyle(document.body).backgroundColor;
  const lines = contours.map(({ segments }) => pathOf(segments, width, height));
  lines.forEach((line) => strokeLine(context, line, edge, 5 * ratio));
  contours.forEach(({ colour, dash }, k) => {
    context.setLineDash(dash.map((n) => n * ratio));
    strokeLine(context, lines[k], getComputedStyle(document.documentElement).getPropertyValue(colour), 2.2 * ratio); // a CSS variable: light and dark differ
  });
  context.setLineDash([]);
}

function pathOf(segments, width, height) {
  const path = new Path2D();
  for (let i = 0; i < segments.length; i += 6) {
    const goesOn = i > 0 && [0, 1, 2].every((k) => segments[i + k] === segments[i + k - 3]);
    if (!goesOn) path.moveTo(...project(segments[i], segments[i + 1], segments[i + 2], width, height));
    path.lineTo(...project(segments[i + 3], segments[i + 4], segments[i + 5], width, height));
  }
  return path;
}

function strokeLine(context, line, colour, wide) {
  context.strokeStyle = colour;
  context.lineWidth = wide;
  context.stroke(line);
}

// Words over an edge in the page's colour, so that points behind them do not hide them.
function writeOver(context, text, x, y, wide) {
  context.save();
  context.lineWidth = wide;
  context.strokeStyle = getComputedStyle(host).backgroundColor;
  context.strokeText(text, x, y);
  context.restore();
  context.fillText(text, x, y);
}

function drawScaleBar(context, width, height, ratio, ink) {
  const perUnit = (width * camera.zoom) / (camera.right - camera.left);
  const length = [1, 2, 5, 10, 20, 50, 100, 200].find((n) => n * perUnit > 40 * ratio) || 500;
  const right = width - 12 * ratio;
  context.strokeStyle = context.fillStyle = ink;
  context.lineWidth = 3 * ratio;
  context.beginPath();
  context.moveTo(right - length * perUnit, height - 14 * ratio);
  context.lineTo(right, height - 14 * ratio);
  context.stroke();
  context.font = `${11 * ratio}px system-ui, sans-serif`;
  context.textAlign = "right";
  context.textBaseline = "bottom";
  writeOver(context, `${length} ${scene.units}`, right, height - 18 * ratio, 3 * ratio);
  context.textAlign = "start";
}

// Where a plane (normal and height) meets a mesh: one segment per triangle that it crosses, in the order of the lines that they make.
function sliceMesh(geometry, matrix, plane) {
  const position = geometry.getAttribute("position");
  const index = geometry.index.array;
  const at = new Float32Array(position.array);
  if (matrix) new THREE.BufferAttribute(at, 3).applyMatrix4(matrix);
  const above = new Float32Array(position.count);
  for (let i = 0; i < above.length; i++) above[i] = plane.x * at[3 * i] + plane.y * at[3 * i + 1] + plane.z * at[3 * i + 2] - plane.w;
  const segments = []; // of each the two edges that it ends at, by a number, and where
  for (let f = 0; f < index.length; f += 3) {
    const found = { edges: [], places: [] };
    for (let k = 0; k < 3; k++) {
      const a = index[f + k], b = index[f + ((k + 1) % 3)];
      const ha = above[a], hb = above[b];
      if (ha < 0 === hb < 0) continue;
      const t = ha / (ha - hb);
      found.edges.push(Math.min(a, b) * position.count + Math.max(a, b));
      found.places.push([0, 1, 2].map((c) => at[3 * a + c] + t * (at[3 * b + c] - at[3 * a + c])));
    }
    if (found.edges.length === 2) segments.push(found);
  }
  return Float32Array.from(inLines(segments));
}

// The segments, each where the one before it ends as far as there is one: dashes go on over joints.
function inLines(segments) {
  const at = new Map();
  segments.forEach((one) => one.edges.forEach((edge) => at.set(edge, [...(at.get(edge) ?? []), one])));
  const left = new Set(segments);
  const out = [];
  const begins = segments.filter(({ edges }) => edges.some((edge) => at.get(edge).length === 1));
  for (const first of [...begins, ...segments]) {
    if (!left.has(first)) continue;
    let [one, from] = [first, at.get(first.edges[1]).length === 1 ? 1 : 0];
    while (one) {
      left.delete(one);
      out.push(...one.places[from], ...one.places[1 - from]);
      const edge = one.edges[1 - from];
      one = at.get(edge).find((other) => left.has(other));
      if (one) from = one.edges[0] === edge ? 0 : 1;
    }
  }
  return out;
}
