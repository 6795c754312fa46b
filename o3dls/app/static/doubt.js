// A doubt of a reader: its question, and for each answer a button with the picture that it gives, as soon as that is read.

function askDoubt(box, doubt, goOn, look) {
  box.hidden = !doubt;
  if (!doubt) return;
  box.querySelector("p").textContent = doubt.question;
  const choices = doubt.answers.map(({ words, settings }) => {
    const button = made("button", words, { type: "button" });
    button.addEventListener("click", () => { box.hidden = true; goOn(settings); });
    const choice = made("div", undefined, { className: "choice" });
    choice.append(button);
    return choice;
  });
  box.querySelector(".choices").replaceChildren(...choices);
  choices[0]?.querySelector("button").focus();
  if (look) showAnswers(choices, doubt.answers, look);
}

// One after the other, since one reader reads them, and none once the question is answered.
async function showAnswers(choices, answers, look) {
  for (const [k, { settings }] of answers.entries()) {
    const choice = choices[k];
    if (!choice.isConnected || choice.closest("[hidden]")) return;
    const seen = await look(settings);
    if (seen.picture) choice.querySelector("button").prepend(made("img", undefined, { src: `data:image/png;base64,${seen.picture}`, alt: "" }));
    const size = seen.facts && [seen.facts.Volume, seen.facts.Size].filter(Boolean).join(", ");
    choice.append(made("small", size ?? seen.doubt?.question ?? seen.error, { className: "soft" }));
  }
}
