// The distance tool: two clicks on surfaces give the straight distance between them, drawn in all panels.

const measuring = { on: false, ends: [] };

function toggleMeasuring() {
  if (measuring.on) return stopMeasuring();
  measuring.on = true;
  showMeasuring("Distance: click on a surface where it begins.");
}

function stopMeasuring() {
  Object.assign(measuring, { on: false, ends: [] });
  showMeasuring(describe(pinned) || HINT);
}

function showMeasuring(text) {
  $("measure").setAttribute("aria-pressed", String(measuring.on));
  host.classList.toggle("measuring", measuring.on);
  write(text, "polite");
  invalidate();
}

// A third click begins anew.
function measureTo(found) {
  if (!found) return;
  measuring.ends = [...measuring.ends, found.at].slice(measuring.ends.length === 2 ? 2 : 0);
  showMeasuring(measuring.ends.length === 2 ? `Distance: ${measuredLength()}` : "Distance: click where it ends.");
}

const measuredLength = () => `${measuring.ends[0].distanceTo(measuring.ends[1]).toFixed(1)} ${scene.units}`;

function drawMeasured(context, width, height, ratio, ink) {
  const ends = measuring.ends.map((at) => project(...at.toArray(), width, height));
  ends.forEach((end) => drawRing(context, end, 3, ratio, ink));
  if (ends.length < 2) return;
  context.strokeStyle = ink;
  context.lineWidth = 2 * ratio;
  context.beginPath();
  ends.forEach((end) => context.lineTo(...end));
  context.stroke();
  drawTag(context, measuredLength(), (ends[0][0] + ends[1][0]) / 2, (ends[0][1] + ends[1][1]) / 2 - 16 * ratio, ratio, ink);
}

function drawTag(context, text, x, y, ratio, ink) {
  context.font = `bold ${13 * ratio}px system-ui, sans-serif`;
  const wide = context.measureText(text).width + 8 * ratio;
  context.fillStyle = getComputedStyle(document.body).backgroundColor;
  context.fillRect(x - wide / 2, y - 10 * ratio, wide, 20 * ratio);
  context.fillStyle = ink;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(text, x, y);
  context.textAlign = "start";
}
