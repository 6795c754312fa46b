// Handles at the ends of a colour bar: dragged or moved by keys, they write into the number fields beside the bar.

const STEPS = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 }; // per cent of the automatic range
const NARROWEST = 0.01; // of the range at the start: the ends stay apart

function connectHandles(id, automatic, signed = () => false) {
  const bar = $(id);
  bar.signed = signed;
  for (const handle of bar.querySelectorAll(".handle")) {
    handle.addEventListener("keydown", (event) => stepEnd(bar, handle, automatic(), event));
    connectDrag(bar, handle);
  }
}

const endOf = (handle) => (handle.classList.contains("at-low") ? ".low" : ".high");
const rangeOf = (bar) => [".low", ".high"].map((end) => bar.querySelector(end).valueAsNumber);

function typeEnd(bar, end, value) {
  const field = bar.querySelector(end);
  field.value = Number(value.toPrecision(3));
  field.dispatchEvent(new Event("change"));
}

function stepEnd(bar, handle, [low, high], event) {
  const end = endOf(handle);
  const { key } = event;
  if (!STEPS[key] && key !== "Home") return;
  event.preventDefault();
  const now = bar.querySelector(end).valueAsNumber;
  moveEnd(bar, end, key === "Home" ? (end === ".low" ? low : high) : now + (STEPS[key] * (high - low)) / 100, high - low);
}

// An end does not pass the other one; of signed values, whose ends mirror each other, it does not pass zero.
function moveEnd(bar, end, value, span) {
  const [low, high] = bar.signed() ? [0, 0] : rangeOf(bar);
  const room = NARROWEST * span;
  typeEnd(bar, end, end === ".low" ? Math.min(value, high - room) : Math.max(value, low + room));
}

// While a handle is held the bar keeps the range that it had, and its colours move in it.
function connectDrag(bar, handle) {
  let held = null;
  handle.addEventListener("pointerdown", (event) => {
    handle.setPointerCapture(event.pointerId);
    held = rangeOf(bar);
    bar.classList.add("held");
  });
  handle.addEventListener("pointermove", ({ clientX }) => {
    if (!held) return;
    const box = bar.querySelector("canvas").getBoundingClientRect();
    const [low, high] = held;
    moveEnd(bar, endOf(handle), low + ((clientX - box.left) / box.width) * (high - low), high - low);
    const places = rangeOf(bar).map((value) => (value - low) / (high - low));
    paintColours(bar, ...places);
    placeHandles(bar, ...places);
  });
  const release = () => {
    held = null;
    bar.classList.remove("held");
    paintColours(bar);
    placeHandles(bar);
  };
  handle.addEventListener("lostpointercapture", release);
}

// The colours between two places of the bar, and those of its ends beyond them.
function paintColours(bar, from = 0, to = 1) {
  const context = bar.querySelector("canvas").getContext("2d");
  const image = context.createImageData(256, 1);
  const { data } = textures[bar.dataset.map].image;
  for (let i = 0; i < 256; i++) {
    const k = 4 * Math.round(255 * Math.min(1, Math.max(0, (i / 255 - from) / (to - from))));
    image.data.set(data.subarray(k, k + 4), 4 * i);
  }
  context.putImageData(image, 0, 0);
}

function placeHandles(bar, ...places) {
  [".at-low", ".at-high"].forEach((which, k) => bar.querySelector(which).style.setProperty("--place", places[k] ?? k));
}

function noteHandles(bar, range) {
  [".at-low", ".at-high"].forEach((which, k) => {
    const others = { "aria-valuenow": range[k], "aria-valuemin": k ? range[0] : -1e6, "aria-valuemax": k ? 1e6 : range[1] };
    Object.entries(others).forEach(([name, value]) => bar.querySelector(which).setAttribute(name, Number(value.toPrecision(3))));
  });
}
