// What the page does besides 3D: copy buttons, and what is folded on paper.

for (const button of document.querySelectorAll("[data-copy]")) {
  button.addEventListener("click", async () => {
    const source = document.getElementById(button.dataset.copy);
    try {
      await navigator.clipboard.writeText(source.textContent);
      button.textContent = "Copied";
    } catch {
      getSelection().selectAllChildren(source); // where the clipboard is closed to pages, the text is at least selected
      button.textContent = "Selected";
    }
  });
}

// On paper what is folded is open, but for what only says in numbers what a chart shows; afterwards it is as before.
let unfolded = [];
window.addEventListener("beforeprint", () => {
  unfolded = [...document.querySelectorAll("details:not([open])")].filter((one) => !one.closest("figure"));
  unfolded.forEach((one) => { one.open = true; });
});
window.addEventListener("afterprint", () => unfolded.forEach((one) => { one.open = false; }));
