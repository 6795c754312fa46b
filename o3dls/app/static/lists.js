// What a line of cases and runs says beside its name, and its small picture, one after the other, as they come.

async function fillLines() {
  for (const line of document.querySelectorAll("[data-case], [data-run]")) {
    const { run, case: of } = line.dataset;
    const asked = run ? `grade?folder=${encodeURIComponent(run)}` : `glance?folder=${encodeURIComponent(of)}`;
    const answer = await fetch(asked).then((one) => one.json()).catch(() => ({ error: "no answer" }));
    const shown = line.querySelector(".grade");
    shown.textContent = answer.error ? `cannot be read: ${answer.error}` : answer.said.join(" · ");
    if (answer.picture) line.prepend(made("img", undefined, { src: answer.picture, alt: "" }));
  }
}

function compareChosen() {
  const chosen = [...document.querySelectorAll("[name=run]:checked")].map(({ value }) => ["run", value]);
  if (chosen.length > 1) location.href = `compare?${new URLSearchParams(chosen)}`;
  else say(byId("compared"), "Choose two runs or more.", true);
}

byId("compare")?.addEventListener("click", compareChosen);
fillLines();
