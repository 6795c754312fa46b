// Exports of a run, each with a link to the file and the command that does the same.

async function take(button) {
  const line = button.parentElement.querySelector("[role=status]");
  button.disabled = true;
  say(line, "is written …");
  const answer = await ask("export", { run: app.run, export: button.dataset.export });
  button.disabled = false;
  if (answer.error) return say(line, answer.error, true);
  line.replaceChildren(made("a", answer.file, { href: `export?file=${encodeURIComponent(answer.file)}` }));
  const shown = byId("commands");
  if (!shown.textContent.includes(answer.command)) shown.textContent += `\n${answer.command}`;
  return undefined;
}

for (const button of document.querySelectorAll("[data-export]")) button.addEventListener("click", () => take(button));
