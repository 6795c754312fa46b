// Contours on the image: which slice of each stack is seen, which lines are drawn, and the window of grey values.

for (const whole of document.querySelectorAll(".stacks")) {
  for (const hidden of whole.querySelectorAll("input[hidden], .grey[hidden]")) hidden.hidden = false;

  for (const figure of whole.querySelectorAll(".stack")) {
    const cuts = [...figure.querySelectorAll(".cut")];
    const slider = figure.querySelector("input");
    const said = figure.querySelector("output");
    slider.addEventListener("input", () => {
      cuts.forEach((cut, k) => {
        if (k + 1 === Number(slider.value)) cut.removeAttribute("display");
        else cut.setAttribute("display", "none");
      });
      said.textContent = `${slider.value} of ${cuts.length}: ${cuts[slider.value - 1].dataset.said}`;
    });
  }

  for (const box of whole.querySelectorAll("[data-layer]")) {
    box.checked = true; // a browser may remember what was switched off
    box.addEventListener("change", () => whole.classList.toggle(`no-${box.dataset.layer}`, !box.checked));
  }

  const grey = whole.querySelector(".grey");
  const [low, high] = [Number(grey.dataset.low), Number(grey.dataset.high)];
  const [width, level] = ["window", "level"].map((name) => grey.querySelector(`[data-grey="${name}"]`));
  const setWindow = () => {
    const slope = (high - low) / Number(width.value);
    const intercept = 0.5 - slope * (Number(level.value) - low) / (high - low);
    for (const channel of whole.querySelectorAll("#grey-window feFuncR, #grey-window feFuncG, #grey-window feFuncB")) {
      channel.setAttribute("slope", slope);
      channel.setAttribute("intercept", intercept);
    }
    for (const one of [width, level]) one.nextElementSibling.textContent = Number(one.value).toPrecision(4);
  };
  for (const one of [width, level]) one.addEventListener("input", setWindow);
}
