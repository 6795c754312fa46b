// Files are brought or named, read at once, and made into a case.

const brought = { looking: {} }; // the path of each role
const answered = {}; // the settings that answers stand for, of each role: they go with its file
const slots = new Map([...document.querySelectorAll("[data-role]")].map((slot) => [slot.dataset.role, slot]));
const part = (role, selector) => slots.get(role).querySelector(selector);

function upload(role, file) {
  const request = new XMLHttpRequest();
  const [box, bar, cancel] = [".upload", ".upload progress", ".upload button"].map((one) => part(role, one));
  const end = (text, refused) => { box.hidden = true; say(part(role, ".said"), text, refused); };
  forget(role);
  box.hidden = false;
  bar.value = 0;
  say(part(role, ".said"), `${file.name} is brought …`);
  request.upload.addEventListener("progress", ({ loaded, total }) => { bar.value = loaded / Math.max(total, 1); });
  request.addEventListener("load", () => {
    const answer = JSON.parse(request.responseText || "{}");
    if (!answer.file) return end(answer.error ?? "the server gave no answer", true);
    end("");
    return role === "image" && file.name.endsWith(".zip") ? unpack(answer.file) : take(role, answer.file);
  });
  request.addEventListener("error", () => end("the file did not arrive: is o3dls app still running?", true));
  request.addEventListener("abort", () => end("Cancelled; nothing of the file is kept."));
  cancel.onclick = () => request.abort();
  request.open("PUT", `files/${encodeURIComponent(file.name)}`);
  request.send(file);
}

async function uploadFolder(role, name, list) {
  drop(role);
  say(part(role, ".said"), `${name} is packed …`);
  try {
    upload(role, await zipOf(name, await list));
  } catch (error) {
    say(part(role, ".said"), error.message, true);
  }
}

// An image is a folder of slices.
async function unpack(file) {
  const answer = await ask("unpack", { file });
  if (answer.error) return say(part("image", ".said"), answer.error, true);
  return take("image", answer.file);
}

const settings = () => Object.assign({}, ...Object.values(answered));

function forget(role) {
  delete brought[role];
  part(role, ".read").replaceChildren();
  part(role, ".question").hidden = true;
}

function drop(role) {
  answered[role] = {};
  forget(role);
}

function take(role, file) {
  answered[role] = {};
  return lookAt(role, file);
}

async function lookAt(role, file) {
  const line = part(role, ".said");
  forget(role);
  brought.looking[role] = file;
  say(line, `${file} is read …`);
  const answer = await ask("look", { role, file, settings: settings() });
  if (brought.looking[role] !== file) return; // another was chosen meanwhile
  say(line, answer.doubt ? "" : answer.error ?? `Read: ${file}`, Boolean(answer.error));
  askDoubt(part(role, ".question"), answer.doubt, (chosen) => {
    Object.assign(answered[role], chosen);
    lookAt(role, file);
  }, (chosen) => ask("look", { role, file, settings: { ...settings(), ...chosen } }));
  if (answer.error) return;
  brought[role] = file;
  show(role, answer);
  if (role === "map" && !byId("name").value) byId("name").value = file.split("/").at(-1).replace(/\..*$/, "").replace(/[^\w-]+/g, "_");
}

function show(role, { facts, notes, picture }) {
  const list = made("dl", undefined, { className: "facts" });
  list.append(...Object.entries(facts).map(([key, said]) => {
    const row = made("div");
    row.append(made("dt", key), made("dd", said));
    return row;
  }));
  const more = made("details");
  const lines = made("ul");
  lines.append(...notes.map((note) => made("li", note)));
  more.append(made("summary", `What was taken, and what was not (${notes.length})`), lines);
  const image = picture ? [made("img", undefined, { src: `data:image/png;base64,${picture}`, alt: `${role}, from the front` })] : [];
  part(role, ".read").replaceChildren(...image, list, ...(notes.length ? [more] : []));
}

async function makeCase() {
  const line = byId("answer");
  say(line, "The case is made …");
  const { prior, map, landmarks, image } = brought;
  answered.whose = byId("template").checked ? { prior_of: "template" } : {};
  const answer = await ask("make", { name: byId("name").value.trim(), prior, map, landmarks, image, settings: settings() });
  say(line, answer.doubt ? "" : answer.error ?? "", Boolean(answer.error));
  askDoubt(byId("question"), answer.doubt, (chosen) => {
    answered.make = { ...answered.make, ...chosen };
    makeCase();
  });
  if (answer.error) return;
  sessionStorage.setItem(answer.case, JSON.stringify(answer));
  location.href = `case?folder=${encodeURIComponent(answer.case)}`;
}

// Of what was dropped the first: a file, or a folder where the role may have one.
function takeDropped(role, { items, files }) {
  const entry = items[0]?.webkitGetAsEntry?.();
  if (!entry?.isDirectory) {
    if (files[0]) upload(role, files[0]);
  } else if (byId(`${role}-folder`).closest("[hidden]")) {
    drop(role);
    say(part(role, ".said"), `${entry.name}: is a folder; drop the one file that is meant`, true);
  } else uploadFolder(role, entry.name, filesIn(entry));
}

for (const [role, slot] of slots) {
  const [file, folder] = [byId(`${role}-file`), byId(`${role}-folder`)];
  file.addEventListener("change", () => { if (file.files[0]) upload(role, file.files[0]); });
  folder.addEventListener("change", () => {
    const list = [...folder.files].map((one) => ({ path: one.webkitRelativePath, file: one }));
    if (list.length) uploadFolder(role, list[0].path.split("/")[0], list);
  });
  byId(`${role}-there`).addEventListener("change", ({ target }) => { if (target.value) take(role, target.value); else drop(role); });
  slot.addEventListener("dragover", (event) => event.preventDefault());
  slot.addEventListener("drop", (event) => {
    event.preventDefault();
    takeDropped(role, event.dataTransfer);
  });
}
byId("make").addEventListener("click", makeCase);
