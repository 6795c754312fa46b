// Where to map next: numbers over the pictures, which a box takes away.

if (scene.next.length) offerNext();

function offerNext() {
  checkbox($("kinds").parentElement, "next places", (on) => {
    settings.next = on;
    invalidate();
  }).id = "places";
}

function drawNumber({ name, at, strength }, context, width, height, ratio) {
  const [x, y] = project(...at, width, height);
  context.font = `bold ${12 * ratio}px system-ui, sans-serif`;
  context.globalAlpha = strength;
  context.fillStyle = "#fff";
  context.strokeStyle = "#111";
  context.lineWidth = 2 * ratio;
  context.beginPath();
  context.arc(x, y, 9 * ratio, 0, 2 * Math.PI);
  context.fill();
  context.stroke();
  context.fillStyle = "#111";
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(name, x, y);
  context.textAlign = "start";
  context.globalAlpha = 1;
}
