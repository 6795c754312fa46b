// Grades and small pictures of runs, one after the other, as they come.

async function gradeRuns() {
  for (const line of document.querySelectorAll("[data-run]")) {
    const answer = await fetch(`grade?folder=${encodeURIComponent(line.dataset.run)}`).then((one) => one.json()).catch(() => ({ error: "no answer" }));
    const shown = line.querySelector(".grade");
    shown.textContent = answer.error ? `cannot be read: ${answer.error}` : [answer.grade, ...answer.doubts.slice(0, 2)].join(" · ");
    shown.dataset.grade = answer.grade ?? "";
    if (answer.picture) line.prepend(made("img", undefined, { src: `data:image/webp;base64,${answer.picture}`, alt: "" }));
  }
}

function compareChosen() {
  const chosen = [...document.querySelectorAll("[name=run]:checked")].map(({ value }) => ["run", value]);
  if (chosen.length > 1) location.href = `compare?${new URLSearchParams(chosen)}`;
  else say(byId("compared"), "Choose two runs or more.", true);
}

byId("compare")?.addEventListener("click", compareChosen);
gradeRuns();
