// What the page that acts can do. An action counts when the server has said so; what it refuses is said as it says it.

const TOLD = {
  take: ({ id }) => (id ? `Point ${id} is taken.` : "The point is taken."),
  undo: () => "The point is taken back.",
  retype: (_, { point, type }) => `Point ${point} is ${type} now.`,
  label: (_, { point }) => `Point ${point} is labelled.`,
  prior_landmark: (_, { name }) => `${name} is placed on the prior.`,
  landmark: (_, { name }) => `The next point is ${name}.`,
  fit: () => "A full fit begins as soon as none runs.",
  end: () => "The session ends: the default pipeline runs on all points.",
};

function say(text, refused = false) {
  const line = byId("answer");
  line.textContent = text;
  line.classList.toggle("refused", refused);
}

async function post(path, content) {
  try {
    const answer = await fetch(path, { method: "POST", headers: { "Content-Type": "application/json", "X-Page": page }, body: JSON.stringify(content) });
    return await answer.json();
  } catch {
    return { error: "the server did not answer: nothing is known of this action; look at the points when the connection is back" };
  }
}

async function act(action) {
  const answer = await post("act", action);
  if (answer.error) say(`Refused: ${answer.error}`, true);
  else say(TOLD[action.do](answer, action));
  return !answer.error;
}

function allow() {
  const off = !session.acts || session.ended || !session.connected;
  document.querySelectorAll(".controls").forEach((one) => { one.disabled = off; });
}

function takeRole({ acts, free }) {
  session.acts = acts;
  write("role-now", acts ? "This page acts." : free ? "This page looks on; the page that acted has gone." : "This page looks on: another page acts.");
  byId("ask-role").hidden = acts || !free;
  allow();
}

// What was clicked in the picture.
function onPick(picked) {
  if (picked?.point) byId("chosen").value = picked.point;
  session.place = picked?.place ?? null;
  byId("prior-landmark").disabled = !session.place;
  write("place-now", session.place ? `Chosen on the prior: ${session.place.map((one) => one.toFixed(1)).join(", ")}` : "Click the surface where the landmark is.");
  tellChosen();
}

const chosen = () => session.points.get(byId("chosen").valueAsNumber);

function tellChosen() {
  const point = chosen();
  const typed = byId("chosen").value !== "";
  for (const id of ["retype", "take-back", "label"]) byId(id).disabled = !point;
  if (!point) return write("chosen-now", typed ? "There is no such point." : "Click a point, or type its number.");
  const values = Object.entries(point.values ?? {}).map(([key, value]) => `${key} ${value}`);
  const known = [point.type, ...values, ...(point.distance === null || point.distance === undefined ? [] : [`${point.distance.toFixed(1)} mm from the surface`])];
  return write("chosen-now", known.join(", "));
}

// A number where it reads as one.
function labelled() {
  const [name, text] = [byId("label-name").value.trim(), byId("label-value").value.trim()];
  return { [name]: text !== "" && Number.isFinite(Number(text)) ? Number(text) : text };
}

function named(then) {
  const name = byId("landmark").value.trim();
  if (name) return then(name);
  byId("landmark").focus();
  return say("Refused: a landmark needs a name", true);
}

function connectActions() {
  const on = (id, press) => byId(id).addEventListener("click", press);
  const point = () => byId("chosen").valueAsNumber;
  on("take", () => act({ do: "take", xyz: session.tip, type: byId("take-type").value }));
  on("fit-again", () => act({ do: "fit" }));
  on("undo", () => act({ do: "undo" }));
  on("take-back", () => act({ do: "undo", point: point() }));
  on("retype", () => act({ do: "retype", point: point(), type: byId("new-type").value }));
  on("label", () => act({ do: "label", point: point(), values: labelled() }));
  on("middle", () => { if (!session.view?.pinMiddle()) say("Refused: the surface is not in the middle of the picture", true); });
  on("prior-landmark", () => named((name) => act({ do: "prior_landmark", name, xyz: session.place })));
  on("next-landmark", () => named((name) => act({ do: "landmark", name, next: true })));
  on("end", () => byId("ending").showModal());
  on("end-no", () => byId("ending").close());
  on("end-yes", () => { byId("ending").close(); act({ do: "end" }); });
  on("ask-role", async () => { const answer = await post("role", {}); if (answer.error) say(`Refused: ${answer.error}`, true); });
  byId("chosen").addEventListener("input", () => { tellChosen(); if (chosen()) session.view?.pinPoint(point()); });
}
