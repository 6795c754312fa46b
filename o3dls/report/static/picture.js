// One picture of what the panels show, with case, view, date, version and scales: to save, and for paper.

const PAPER = { width: 1200, height: 900, ratio: 3.2 }; // of a panel on half a page: some 300 dots per inch
const SMALLER = 1.4; // are two rows of panels: their letters must not be
const ROW_HEAD = 24, HEAD = 28, FOOT = 58, LEGEND = 20; // heights in pixels of a screen

// The panels as they were drawn last, `ratio` pixels to one of the screen.
function composed(ratio) {
  const shown = panels.filter((panel) => panel.shown);
  if (!shown.length) return null;
  const { width, height } = shown[0].canvas;
  const columns = shown.length > 3 ? 2 : shown.length;
  const row = height + ROW_HEAD * ratio;
  const rows = Math.ceil(shown.length / columns);
  const foot = FOOT + (contours.length ? LEGEND : 0);
  const out = document.createElement("canvas");
  Object.assign(out, { width: columns * width, height: Math.round((HEAD + foot) * ratio + rows * row) });
  const context = out.getContext("2d");
  const style = getComputedStyle(document.body);
  context.fillStyle = style.backgroundColor;
  context.fillRect(0, 0, out.width, out.height);
  context.fillStyle = style.color;
  writeText(context, seen(), 8 * ratio, 18 * ratio, 12 * ratio, out.width - 16 * ratio);
  shown.forEach((panel, k) => {
    const [x, y] = [(k % columns) * width, HEAD * ratio + Math.floor(k / columns) * row];
    writeText(context, panel.name, x + 8 * ratio, y + 16 * ratio, 13 * ratio, width - 16 * ratio, 600);
    context.drawImage(panel.canvas, x, y + ROW_HEAD * ratio);
  });
  const bars = [...document.querySelectorAll(".bar")].filter((bar) => !bar.hidden);
  const under = HEAD * ratio + rows * row;
  bars.forEach((bar, k) => paintBar(context, bar, 16 * ratio + (k * out.width) / 2, under + 6 * ratio, ratio));
  paintLegend(context, 16 * ratio, under + (FOOT + 8) * ratio, ratio);
  return out;
}

// What is seen and by whom it was made, in one line.
function seen() {
  const ghost = $("ghost").value;
  const step = shared.isochrones.value;
  const more = [ghost && `ghost: ${ghost}`, step && `isochrones every ${step} ${settings.field.unit}`].filter(Boolean);
  return [scene.name, `view ${$("view-name").textContent}`, ...more, scene.made].join(" · ");
}

function writeText(context, text, x, y, size, most, weight = 400) {
  context.font = `${weight} ${size}px system-ui, sans-serif`;
  context.fillText(text, x, y, most);
}

// The colours with their name, marks at ends beyond which there are values, and numbers.
function paintBar(context, bar, x, y, ratio) {
  const [wide, size] = [Math.min(300 * ratio, context.canvas.width / 2 - 56 * ratio), 11 * ratio];
  context.font = `${size}px system-ui, sans-serif`;
  paintScale(context, bar, x + 14 * ratio, y, wide, 10 * ratio);
  writeText(context, bar.querySelector(".name").textContent, x, y + 40 * ratio, size, context.canvas.width / 2 - 24 * ratio);
}

// Names of the contours in a cut.
function paintLegend(context, left, y, ratio) {
  let x = left;
  for (const { name, colour, dash } of contours) {
    context.strokeStyle = getComputedStyle(document.documentElement).getPropertyValue(colour);
    context.lineWidth = 2 * ratio;
    context.setLineDash(dash.map((n) => n * ratio));
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(x + 24 * ratio, y);
    context.stroke();
    writeText(context, name, x + 28 * ratio, y + 4 * ratio, 11 * ratio, 200 * ratio);
    x += 44 * ratio + context.measureText(name).width;
  }
  context.setLineDash([]);
}

function savePicture() {
  const picture = composed(pixelRatio());
  if (!picture) return;
  const link = document.createElement("a");
  link.download = `${scene.file}.png`;
  link.href = picture.toDataURL("image/png");
  link.click();
}

// Paper shows the present view, drawn anew in the colours of paper. A canvas, since an image would not be decoded in time.
function putOnPaper() {
  const { classList } = document.documentElement;
  classList.add("printing");
  const ratio = PAPER.ratio * (panels.filter((panel) => panel.shown).length > 3 ? SMALLER : 1);
  drawAll(() => ({ ...PAPER, ratio }));
  const picture = composed(ratio);
  classList.remove("printing");
  drawAll();
  takeOffPaper();
  if (!picture) return;
  picture.id = "printed";
  picture.setAttribute("role", "img");
  picture.setAttribute("aria-label", seen());
  $("viewer").before(picture);
}

function takeOffPaper() {
  $("printed")?.remove();
}

window.addEventListener("beforeprint", putOnPaper);
window.addEventListener("afterprint", takeOffPaper);
