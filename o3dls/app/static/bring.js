// Files are brought or named, read at once, and made into a case.

const brought = { settings: {} }; // the path of each role, and what was answered to doubts
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
    return lookAt(role, answer.file);
  });
  request.addEventListener("error", () => end("the file did not arrive: is o3dls app still running?", true));
  request.addEventListener("abort", () => end("Cancelled; nothing of the file is kept."));
  cancel.onclick = () => request.abort();
  request.open("PUT", `files/${encodeURIComponent(file.name)}`);
  request.send(file);
}

function forget(role) {
  delete brought[role];
  part(role, ".read").replaceChildren();
  part(role, ".question").hidden = true;
}

async function lookAt(role, file) {
  const line = part(role, ".said");
  forget(role);
  brought.looking = { ...brought.looking, [role]: file };
  say(line, `${file} is read …`);
  const answer = await ask("look", { role, file, settings: brought.settings });
  if (brought.looking[role] !== file) return; // another was chosen meanwhile
  say(line, answer.doubt ? "" : answer.error ?? `Read: ${file}`, Boolean(answer.error));
  askDoubt(part(role, ".question"), answer.doubt, (settings) => {
    Object.assign(brought.settings, settings);
    lookAt(role, file);
  });
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
  const { settings, prior, map, landmarks } = brought;
  const answer = await ask("make", { name: byId("name").value.trim(), prior, map, landmarks, settings });
  say(line, answer.doubt ? "" : answer.error ?? "", Boolean(answer.error));
  askDoubt(byId("question"), answer.doubt, (more) => {
    Object.assign(brought.settings, more);
    makeCase();
  });
  if (answer.error) return;
  sessionStorage.setItem(answer.case, JSON.stringify(answer));
  location.href = `case?folder=${encodeURIComponent(answer.case)}`;
}

for (const [role, slot] of slots) {
  const input = byId(`${role}-file`);
  input.addEventListener("change", () => { if (input.files[0]) upload(role, input.files[0]); });
  byId(`${role}-there`).addEventListener("change", ({ target }) => { if (target.value) lookAt(role, target.value); else forget(role); });
  slot.addEventListener("dragover", (event) => event.preventDefault());
  slot.addEventListener("drop", (event) => {
    event.preventDefault();
    if (event.dataTransfer.files[0]) upload(role, event.dataTransfer.files[0]);
  });
}
byId("make").addEventListener("click", makeCase);
