// A handle at each end of a colour bar: dragged, or moved by keys, it does what typing the number beside it does.

const STEPS = 50, FINE = 200; // of the automatic range for one key press, of the bar for one place of a dragged handle
const ENDS = ["low", "high"];

function connectHandles(bar, automatic, signed) {
  bar.automatic = automatic;
  const input = (end) => bar.querySelector(`.${end}`);
  // A whole number of steps that leaves something of the range; of signed values, of its half.
  const set = (end, value, step) => {
    const [low, high] = signed() ? [0, 0] : ENDS.map((one) => input(one).valueAsNumber);
    const kept = end === "low" ? Math.min(value, high - step) : Math.max(value, low + step);
    input(end).value = Number((step * Math.round(kept / step)).toPrecision(10));
    input(end).dispatchEvent(new Event("change"));
  };
  ENDS.forEach((end) => {
    const handle = document.createElement("span");
    Object.assign(handle, { className: `handle ${end}-handle`, tabIndex: 0, role: "slider" });
    handle.setAttribute("aria-label", input(end).getAttribute("aria-label").replace(" end ", " handle "));
    handle.addEventListener("keydown", (event) => {
      const steps = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 }[event.key];
      if (!steps) return;
      event.preventDefault();
      const step = roundStep((automatic()[1] - automatic()[0]) / STEPS);
      set(end, input(end).valueAsNumber + steps * step, step);
    });
    connectDrag(handle, bar, (value, span) => set(end, value, roundStep(span / FINE)));
    bar.querySelector(".handles").append(handle);
  });
}

// While a handle is dragged the bar keeps its numbers, and the colours move between the handles.
function connectDrag(handle, bar, change) {
  handle.addEventListener("pointerdown", ({ pointerId, clientX }) => {
    handle.setPointerCapture(pointerId);
    const { left, width } = bar.querySelector(".handles").getBoundingClientRect();
    const place = parseFloat(handle.style.left) / 100;
    bar.held = { axis: rangeOf(bar), width, grip: clientX - left - place * width, left };
  });
  handle.addEventListener("pointermove", ({ pointerId, clientX }) => {
    if (!handle.hasPointerCapture(pointerId)) return;
    const { axis: [low, high], left, width, grip } = bar.held;
    change(low + ((clientX - left - grip) / width) * (high - low), high - low);
  });
  handle.addEventListener("lostpointercapture", () => {
    bar.held = null;
    markBars();
  });
}

// The largest of 1, 2 or 5 times a power of ten that is no more than a number.
function roundStep(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].map((n) => n * power).find((step) => step <= most * (1 + 1e-9));
}

const rangeOf = (bar) => (bar.id === "surface-bar" ? shared.range.value : settings.pointRange).slice();

// The numbers that the ends of a bar stand for: those of its colours, but while a handle is held.
function axisOf(bar) {
  const [low, high] = rangeOf(bar);
  const held = bar.held?.axis ?? [low, high];
  return [Math.min(low, held[0]), Math.max(high, held[1])];
}

function placeHandles(bar) {
  const range = rangeOf(bar);
  const [first, last] = axisOf(bar);
  const [lowest, highest] = bar.automatic();
  bar.querySelectorAll(".handle").forEach((handle, k) => {
    handle.style.left = `${(100 * (range[k] - first)) / (last - first)}%`;
    const [least, most] = k === 0 ? [Math.min(lowest, first), range[1]] : [range[0], Math.max(highest, last)];
    const said = { valuemin: least, valuemax: most, valuenow: range[k] };
    for (const [name, value] of Object.entries(said)) handle.setAttribute(`aria-${name}`, Number(value.toPrecision(3)));
  });
  spreadColours(bar, range, [first, last]);
}

// The colours between the handles, and beyond them those of the ends.
function spreadColours(bar, [low, high], [first, last]) {
  const context = bar.querySelector("canvas").getContext("2d");
  const image = context.createImageData(256, 1);
  for (let i = 0; i < 256; i++) {
    const share = (first + ((last - first) * i) / 255 - low) / (high - low);
    const k = 4 * Math.round(255 * Math.min(1, Math.max(0, share)));
    image.data.set(textures[bar.dataset.map].image.data.subarray(k, k + 4), 4 * i);
  }
  context.putImageData(image, 0, 0);
}
