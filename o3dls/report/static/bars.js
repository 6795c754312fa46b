// Colour bars: round numbers under them, and a mark at an end beyond which the shown estimates have values.

const BEYOND = "values beyond are shown in the end's colour";

// Up to six multiples of 1, 2, 2.5 or 5 times a power of ten between two numbers, the numbers themselves among them where they can be.
function ticks(low, high) {
  const power = 10 ** Math.floor(Math.log10(high - low)) / 10;
  const slack = 1e-9 * (high - low);
  const steps = [1, 2, 2.5, 5, 10, 20].map((n) => n * power);
  const spans = steps.map((step) => ({ step, first: Math.ceil((low - slack) / step), last: Math.floor((high + slack) / step) }));
  const reachesEnds = ({ step, first, last }) => last - first < 6 && first * step < low + slack && last * step > high - slack;
  const { step, first, last } = spans.find(reachesEnds) || spans.find((span) => span.last - span.first < 5);
  return Array.from({ length: last - first + 1 }, (_, k) => Number(((first + k) * step).toPrecision(10)));
}

function markBars() {
  markBar($("surface-bar"), shared.range.value, surfaceValues());
  markBar($("point-bar"), settings.pointRange, panels.filter((panel) => panel.shown).map((panel) => cloud.residuals[panel.estimate]));
}

// Arrays of what has the colours of the surface: the field of the shown estimates, and the points' own values.
function surfaceValues() {
  const { field } = settings;
  const shown = panels.filter((panel) => panel.shown).map((panel) => panel.geometry.getAttribute("value").array);
  return field ? [...shown, ...(ownValues(field) ? [ownValues(field)] : [])] : [];
}

function markBar(bar, [low, high], values) {
  const slack = 1e-4 * (high - low); // values are packed in 16 bits
  const beyond = (found) => values.some((array) => array.some((value) => value > -1e20 && found(value)));
  const [under, over] = [beyond((value) => value < low - slack), beyond((value) => value > high + slack)];
  bar.querySelector(".under").hidden = !under;
  bar.querySelector(".over").hidden = !over;
  const signOf = (value) => (under && value <= low + slack ? "≤ " : over && value >= high - slack ? "≥ " : "");
  const marks = ticks(low, high).map((value) => {
    const made = document.createElement("span");
    made.textContent = signOf(value) + value;
    made.style.left = `${(100 * (value - low)) / (high - low)}%`;
    return made;
  });
  bar.querySelector(".ticks").replaceChildren(...marks);
  noteHandles(bar, [low, high]);
}

function fillBars() {
  for (const mark of document.querySelectorAll(".bar .beyond")) mark.title = BEYOND;
}

// The same in a picture: colours `wide` and `tall` at a place, numbers below them.
function paintScale(context, bar, x, y, wide, tall) {
  context.drawImage(bar.querySelector("canvas"), x, y, wide, tall);
  if (!bar.querySelector(".under").hidden) paintTriangle(context, x - 3, y, -tall, tall);
  if (!bar.querySelector(".over").hidden) paintTriangle(context, x + wide + 3, y, tall, tall);
  context.textAlign = "center";
  for (const mark of bar.querySelectorAll(".ticks span")) {
    const at = x + (wide * parseFloat(mark.style.left)) / 100;
    context.fillRect(at - 1, y + tall, 2, tall / 3);
    context.fillText(mark.textContent, at, y + 2.5 * tall);
  }
  context.textAlign = "start";
}

function paintTriangle(context, x, y, wide, tall) {
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(x + wide, y + tall / 2);
  context.lineTo(x, y + tall);
  context.fill();
}
