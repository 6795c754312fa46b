// In a strip of dots Tab reaches one, and arrow keys lead from dot to dot in the order of their values.
for (const strip of document.querySelectorAll("svg.metric")) {
  const dots = [...strip.querySelectorAll(".of-run")];
  const stopAt = (k) => dots.forEach((dot, n) => dot.setAttribute("tabindex", n === k ? "0" : "-1"));
  stopAt(dots.length - 1); // the largest
  strip.addEventListener("focusin", ({ target }) => stopAt(dots.indexOf(target.closest(".of-run"))));
  strip.addEventListener("keydown", (event) => {
    const at = dots.indexOf(document.activeElement);
    const to = { ArrowRight: at + 1, ArrowUp: at + 1, ArrowLeft: at - 1, ArrowDown: at - 1, Home: 0, End: dots.length - 1 }[event.key];
    if (at < 0 || to === undefined) return;
    event.preventDefault();
    dots[Math.min(dots.length - 1, Math.max(0, to))].focus();
  });
}
