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

// A doubt of a reader: its question, and a button for each answer, which goes on with the settings that it stands for.
function askDoubt(box, doubt, goOn) {
  box.hidden = !doubt;
  if (!doubt) return;
  box.querySelector("p").textContent = doubt.question;
  const buttons = doubt.answers.map(({ words, settings }) => {
    const button = made("button", words, { type: "button" });
    button.addEventListener("click", () => { box.hidden = true; goOn(settings); });
    return button;
  });
  box.querySelector(".choices").replaceChildren(...buttons);
  buttons[0]?.focus();
}

requestAnimationFrame(() => { document.documentElement.dataset.shown = ""; });
