// The expected error over the number of points, as a small chart that is drawn anew with every state.

const CHART = { left: 30, right: 84, top: 8, bottom: 24, width: 340, height: 150 };
const LINES = [{ name: "mapped", at: 1, style: "s0" }, { name: "unmapped", at: 2, style: "s1 d1" }];

function drawHistory(history) {
  const known = LINES.map((line) => ({ ...line, places: history.filter((row) => row[line.at] !== null).map((row) => [row[0], row[line.at]]) })).filter(({ places }) => places.length);
  const svg = byId("history");
  svg.closest("figure").hidden = !known.length;
  if (!known.length) return svg.replaceChildren();
  const every = known.flatMap(({ places }) => places);
  const [first, last] = [Math.min(...every.map(([n]) => n)), Math.max(...every.map(([n]) => n))];
  const top = niceAbove(Math.max(...every.map(([, error]) => error)));
  const x = (n) => CHART.left + ((n - first) / Math.max(last - first, 1)) * (CHART.width - CHART.left - CHART.right);
  const y = (error) => CHART.height - CHART.bottom - (error / top) * (CHART.height - CHART.bottom - CHART.top);
  svg.replaceChildren(...axes(x, y, first, last, top), ...known.flatMap((line) => oneLine(line, x, y, known)));
  const now = known.map(({ name, places }) => `${name} wall ${millimetres(places.at(-1)[1])}`).join(", ");
  svg.setAttribute("aria-label", `Expected error after ${last} points: ${now}`);
}

function niceAbove(value) {
  const power = 10 ** Math.floor(Math.log10(Math.max(value, 1e-3)));
  return [1, 2, 5, 10].map((n) => n * power).find((n) => n >= value);
}

function axes(x, y, first, last, top) {
  const levels = [0, top / 2, top].flatMap((error) => [
    shape("line", { class: "grid", x1: x(first), x2: CHART.width - CHART.right, y1: y(error), y2: y(error) }),
    words(Number(error.toPrecision(2)), CHART.left - 5, y(error) + 4, "end"),
  ]);
  const ends = [...new Set([first, last])].map((n) => words(n, x(n), CHART.height - 6, "middle"));
  return [...levels, ...ends];
}

// The line with its name at its end; names that would touch are moved apart.
function oneLine({ name, places, style }, x, y, known) {
  const [n, error] = places.at(-1);
  const heights = known.map((line) => y(line.places.at(-1)[1]));
  const close = heights.length > 1 && Math.abs(heights[0] - heights[1]) < 14;
  const upper = y(error) === Math.min(...heights) && !(heights[0] === heights[1] && name === "unmapped");
  const height = close ? (heights[0] + heights[1]) / 2 + (upper ? -7 : 7) : y(error);
  return [
    shape("polyline", { class: `series ${style}`, points: places.map((one) => `${x(one[0])},${y(one[1])}`).join(" ") }),
    shape("circle", { class: `f${style[1]}`, cx: x(n), cy: y(error), r: 3 }),
    words(name, x(n) + 8, height + 4, "start"),
  ];
}

function words(text, x, y, anchor) {
  const made = shape("text", { x, y, "text-anchor": anchor });
  made.textContent = text;
  return made;
}

function shape(name, attributes) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  Object.entries(attributes).forEach(([key, value]) => made.setAttribute(key, value));
  return made;
}
