// Names of landmarks and of regions not to rely on, beside the surface at the left and the right, each with a line to its place: a name hides neither wall nor another name.

const NAME_ROW = 18; // pixels from name to name
const CUBE_ROOM = 92, BAR_ROOM = 40; // pixels that the cube takes at the lower left and the scale bar at the lower right
const LONGEST = 24; // letters of a name
const BEHIND = 0.8; // strength of a name whose place is behind the wall: it is read, its line alone is faint

if (scene.doubts.length) offerDoubts();

function offerDoubts() {
  checkbox($("kinds").parentElement, "do not rely on", (on) => {
    settings.doubts = on;
    invalidate();
  }).id = "doubts";
}

const shortened = (name) => (name.length > LONGEST ? `${name.slice(0, LONGEST - 1)}…` : name);

// What has a name in a panel: its text, its place and whether it is a doubt.
function namedIn(panel) {
  const marks = settings.labels ? scene.landmarks.map(({ name, at }, k) => ({ text: shortened(name), at, hidden: panel.hidden?.marks[k] })) : [];
  const doubts = settings.doubts ? scene.doubts.map(({ name }, k) => ({ text: shortened(name), at: onWall(panel, k), hidden: panel.hidden?.doubts[k], doubt: true })) : [];
  return [...marks, ...doubts];
}

// A place of a doubt on the wall of a panel: the vertex of its surface that is nearest to it.
const nearestVertices = new WeakMap(); // by geometry
function onWall({ geometry, mesh }, k) {
  const own = geometryOf(mesh);
  if (!nearestVertices.has(own)) nearestVertices.set(own, scene.doubts.map(({ at }) => nearestVertex(own, at)));
  const place = geometry.getAttribute("position"), i = nearestVertices.get(own)[k];
  return [place.getX(i), place.getY(i), place.getZ(i)];
}

function nearestVertex(geometry, [x, y, z]) {
  const { array } = geometry.getAttribute("position");
  let [nearest, least] = [0, Infinity];
  for (let i = 0; i < array.length; i += 3) {
    const far = (array[i] - x) ** 2 + (array[i + 1] - y) ** 2 + (array[i + 2] - z) ** 2;
    if (far < least) [nearest, least] = [i / 3, far];
  }
  return nearest;
}

function drawLabels(panel, context, width, height, ratio, ink) {
  const [middle, reach] = outlineOf(panel, width, height);
  const marks = namedIn(panel).map(({ text, at, hidden, doubt }) => {
    const [x, y] = project(...at, width, height);
    const font = `${doubt ? "bold " : ""}${12 * ratio}px system-ui, sans-serif`;
    context.font = font;
    return { text, x, y, row: y, font, doubt, wide: context.measureText(text).width, strength: hidden ? FAINT : 1 };
  });
  for (const right of [false, true]) {
    const side = marks.filter(({ x }) => x >= middle === right).sort((a, b) => a.y - b.y);
    spreadRows(side, 12 * ratio, height - (right ? BAR_ROOM : CUBE_ROOM) * ratio, NAME_ROW * ratio);
    for (const mark of side) {
      const [far, last] = right ? [middle + reach, width - mark.wide - 6 * ratio] : [middle - reach - mark.wide, 6 * ratio];
      drawLabel({ ...mark, left: right ? Math.min(far, last) : Math.max(far, last), right }, context, ratio, ink);
    }
  }
}

// The middle of the surface in the picture, and how far it may reach to each side, in pixels.
function outlineOf({ geometry }, width, height) {
  if (!geometry.boundingSphere) geometry.computeBoundingSphere();
  const { center, radius } = geometry.boundingSphere;
  return [project(center.x, center.y, center.z, width, height)[0], (radius * width * camera.zoom) / (camera.right - camera.left)];
}

// Rows from the top down, none nearer to the next than a gap, and then from the bottom up.
function spreadRows(side, top, bottom, gap) {
  side.forEach((mark, k) => { mark.row = Math.max(mark.y, k ? side[k - 1].row + gap : top); });
  for (let k = side.length - 1; k >= 0; k--) side[k].row = Math.min(side[k].row, k < side.length - 1 ? side[k + 1].row - gap : bottom);
}

function drawLabel({ text, x, y, row, font, left, wide, right, strength, doubt }, context, ratio, plain) {
  const ink = doubt ? getComputedStyle(host).getPropertyValue("--bad") : plain;
  context.font = font;
  const edge = getComputedStyle(host).backgroundColor;
  const end = right ? left - 3 * ratio : left + wide + 3 * ratio;
  context.globalAlpha = strength;
  if (strength < 1) context.setLineDash([2 * ratio, 2 * ratio]);
  const ring = 3.5 * ratio, away = Math.max(Math.hypot(end - x, row - y), ring);
  const line = new Path2D();
  line.moveTo(x + (ring * (end - x)) / away, y + (ring * (row - y)) / away);
  line.lineTo(end, row);
  strokeLine(context, line, edge, 3 * ratio);
  strokeLine(context, line, ink, ratio);
  context.lineWidth = 1.5 * ratio;
  context.beginPath();
  context.arc(x, y, ring, 0, 2 * Math.PI);
  context.stroke();
  context.setLineDash([]);
  const read = strength < 1 ? BEHIND : 1;
  context.globalAlpha = 0.8 * read;
  context.fillStyle = edge;
  context.fillRect(left - 2 * ratio, row - 8 * ratio, wide + 4 * ratio, 16 * ratio);
  context.globalAlpha = read;
  context.fillStyle = ink;
  context.textBaseline = "middle";
  context.fillText(text, left, row);
  context.globalAlpha = 1;
}
