// What all pages of the app do: ask the server, and say what it answers.

const byId = (id) => document.getElementById(id);
const read = (id) => JSON.parse(byId(id)?.textContent ?? "{}");
const app = read("app");
if (location.search.startsWith("?token=")) history.replaceState(null, "", location.pathname + location.hash); // the token is a cookie by now

async function ask(path, content) {
  try {
    const answer = await fetch(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(content) });
    return await answer.json();
  } catch {
    return { error: "the server did not answer: is o3dls app still running?" };
  }
}

function say(line, text, refused = false) {
  line.textContent = text;
  line.classList.toggle("refused", refused);
}

function made(name, text, more = {}) {
  const element = document.createElement(name);
  if (text !== undefined) element.textContent = text;
  return Object.assign(element, more);
}

requestAnimationFrame(() => { document.documentElement.dataset.shown = ""; });
