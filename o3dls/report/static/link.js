// The state of the view in the page's address, behind the #: what differs from how the page opens, as key=text&key=text.

const NOTE_AFTER = 400; // ms after a change; browsers refuse addresses that change more than three times a second
const AXES = ["x", "y", "z"];
const link = { timer: 0, opened: null, noted: "" }; // the state in which the page opens; what was noted last

const round = (value) => Number(value.toPrecision(4));
const listed = (values) => values.map(round).join(",");
const changed = (values, automatic) => (listed(values) === listed(automatic) ? "" : listed(values));
const within = (text, low, high) => text.trim() !== "" && Number(text) >= low && Number(text) <= high; // false for NaN

// Each part of the state: what it says now ("" for nothing, or a list), and what a text does; one that does not fit does nothing.
const STATE = {
  view: { read: () => activeView()?.name ?? "", write: (name) => looking(scene.views.find((one) => one.name === name)?.from) },
  from: {
    read: () => (activeView() ? "" : listed(camera.position.clone().sub(target).normalize().toArray())),
    write: (text) => looking(triple(text)),
  },
  zoom: {
    read: () => String(round(camera.zoom)),
    write: (text) => { if (within(text, 0.01, 1000)) camera.zoom = Number(text); },
  },
  target: { read: () => listed(target.toArray()), write: aim },
  field: { read: () => $("field").value || "none", write: (text) => choose("field", text === "none" ? "" : text) },
  range: {
    read: () => (settings.field ? changed(shared.range.value, settings.field.range) : ""),
    write: (text) => typeRange("surface-bar", text),
  },
  points: { read: () => changed(settings.pointRange, scene.points.range), write: (text) => typeRange("point-bar", text) },
  isochrones: { read: stepNow, write: typeStep },
  cut: { read: cutNow, write: cutAt },
  ghost: { read: () => $("ghost").value, write: (text) => choose("ghost", text) },
  translucent: { read: () => $("translucent").value, write: (text) => { if (within(text, 0, 0.9)) slide("translucent", text); } },
  estimates: { read: () => (pair.on ? pair.before : panels).map(({ estimate }) => scene.estimates[estimate].name).join("|"), write: showNamed },
  fit: { read: () => (panels.some(isMoving) ? $("fit").value : ""), write: fitAt },
  hide: {
    read: () => boxes().filter((box) => !box.checked).map(boxName),
    write: (name) => uncheck(boxes().find((box) => boxName(box) === name)),
  },
  labels: { read: () => ($("labels").checked ? "" : "off"), write: (text) => { if (text === "off") uncheck($("labels")); } },
  hatch: { read: () => ($("hatched").checked ? "" : "off"), write: (text) => { if (text === "off") uncheck($("hatched")); } },
  before: { read: () => (pair.on ? optionText("pair-left") : ""), write: (name) => optionNamed("pair-left", name) },
  after: { read: () => (pair.on ? optionText("pair-right") : ""), write: (name) => optionNamed("pair-right", name) },
  divider: {
    read: () => (pair.on ? String(Math.round(pair.split)) : ""),
    write: (text) => { if (pairable() && within(text, 0, 100)) divideAt(Number(text)); },
  },
};

const boxes = () => [...document.querySelectorAll("#shown input, #kinds input, #places input, #doubts input")];
const boxName = (box) => box.parentElement.textContent.trim();
const optionText = (id) => $(id).selectedOptions[0].textContent;

function triple(text) {
  const found = text.split(",").map((one) => (one.trim() === "" ? NaN : Number(one)));
  return found.length === 3 && found.every(Number.isFinite) ? found : undefined;
}

function looking(from) {
  if (from && Math.hypot(...from) > 0) lookFrom(from);
}

// The camera keeps its direction.
function aim(text) {
  const found = triple(text);
  if (!found) return;
  camera.position.sub(target);
  target.set(...found);
  camera.position.add(target);
}

function choose(id, value) {
  if (![...$(id).options].some((one) => one.value === value)) return;
  $(id).value = value;
  $(id).dispatchEvent(new Event("change"));
}

function optionNamed(id, name) {
  const found = [...$(id).options].find((one) => one.textContent === name);
  if (found) $(id).value = found.value;
}

function slide(id, value) {
  $(id).value = value;
  $(id).dispatchEvent(new Event("input"));
}

function uncheck(box) {
  if (box?.checked) box.click();
}

function typeRange(id, text) {
  const [low, high] = triple(`${text},0`) ?? [];
  if (!(low < high)) return;
  Object.assign($(id).querySelector(".low"), { value: low });
  const typed = $(id).querySelector(".high");
  typed.value = high;
  typed.dispatchEvent(new Event("change"));
}

function fitAt(text) {
  if (fit.stops.length > 1 && within(text, 0, fit.stops.length - 1)) slide("fit", text);
}

function stepNow() {
  const { field, steps } = settings;
  return field?.step && steps[field.key] !== field.step ? String(steps[field.key]) : "";
}

function typeStep(text) {
  if (!settings.field?.step || !within(text, 0, 1e6)) return;
  $("step").value = text;
  setStep();
}

function showNamed(text) {
  text.split("|").slice(0, panels.length).forEach((name, k) => {
    const found = scene.estimates.findIndex((one) => one.name === name);
    if (found >= 0 && found !== panels[k].estimate) showEstimate(panels[k], found);
  });
}

// A cut and its level; a free one with its direction too.
function cutNow() {
  const level = round(Number($("level").value));
  const side = flipped ? ":flipped" : "";
  if ($("cut").value === "free") return `free:${level}:${listed(freeNormal.toArray())}${side}`;
  return AXES[$("cut").value] ? `${AXES[$("cut").value]}:${level}${side}` : "";
}

function cutAt(text) {
  const parts = text.split(":");
  const side = parts.at(-1) === "flipped";
  const [letter, level, direction] = side ? parts.slice(0, -1) : parts;
  const along = letter === "free" && triple(direction ?? "");
  if (along && Math.hypot(...along) > 0.5 && within(level ?? "", 0, 1)) {
    Object.assign($("level"), { value: level });
    $("cut").value = "free";
    freeNormal.set(...along).normalize();
    flipped = side;
    cut();
    return;
  }
  if (!AXES.includes(letter) || !within(level ?? "", 0, 1)) return;
  $("level").value = level;
  $("cut").value = String(AXES.indexOf(letter)); // the view is another part of the address
  flipped = side;
  cut();
}

function divideAt(percent) {
  const { zoom } = camera; // which may fit less than both
  setPair(true);
  moveDivider(percent);
  camera.zoom = zoom;
}

function stateNow() {
  camera.lookAt(target);
  const told = ([key, { read }]) => [read()].flat().filter((text) => text !== "").map((text) => `${key}=${plain(text)}`);
  return Object.entries(STATE).flatMap(told);
}

// As an address has it, but for what need not be written in codes.
function plain(text) {
  return encodeURIComponent(text).replace(/%20/g, "+").replace(/%3A/g, ":").replace(/%2C/g, ",");
}

const stateText = () => stateNow().filter((one) => !link.opened.includes(one)).join("&");

function noteState() {
  if (link.opened && !link.timer) link.timer = setTimeout(note, NOTE_AFTER);
}

function note() {
  clearTimeout(link.timer);
  link.timer = 0;
  const text = stateText();
  if (text === link.noted) return; // the name of a section stays
  link.noted = text;
  $("link").textContent = "Copy link";
  history.replaceState(null, "", text ? `#${text}` : location.pathname + location.search);
}

function readState() {
  const given = new URLSearchParams(location.hash.slice(1));
  for (const key of Object.keys(STATE)) given.getAll(key).forEach(STATE[key].write);
  link.noted = stateText();
  invalidate();
}

async function copyLink() {
  note();
  const text = stateText();
  const address = location.href.split("#")[0] + (text && `#${text}`);
  try {
    await navigator.clipboard.writeText(address);
    $("link").textContent = "Copied";
  } catch {
    history.replaceState(null, "", address); // where the clipboard is closed to pages
    $("link").textContent = "It is in the address bar";
  }
}

function connectLink() {
  link.opened = stateNow();
  $("link").addEventListener("click", copyLink);
  window.addEventListener("hashchange", () => { if (location.hash.includes("=")) location.reload(); }); // of another state
  readState();
}
