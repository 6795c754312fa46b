// Wheel and fingers: a picture that has the focus takes them, else the page scrolls; two fingers always zoom. And the whole screen.

let hinted = false;

// Decided anew at each wheel and touch, before the controls of three.js hear of it.
function shareWithPage(canvas, controls) {
  const focused = () => document.activeElement === canvas;
  canvas.addEventListener("wheel", () => {
    controls.enableZoom = focused();
    if (!focused()) hint(canvas);
  }, { capture: true, passive: true });
  canvas.addEventListener("pointerdown", ({ pointerType }) => {
    controls.enableZoom = true;
    controls.enableRotate = pointerType !== "touch" || focused();
  }, { capture: true });
  canvas.addEventListener("touchstart", (event) => {
    if (event.touches.length > 1 && event.cancelable) event.preventDefault(); // else the browser would scroll with both
  }, { passive: false });
  const touches = () => { canvas.style.touchAction = focused() ? "none" : "pan-x pan-y"; };
  canvas.addEventListener("focus", touches);
  canvas.addEventListener("blur", touches);
  touches();
}

// Said once, over the picture.
function hint(canvas) {
  if (hinted) return;
  hinted = true;
  const said = document.createElement("span");
  said.className = "hint";
  said.setAttribute("role", "status");
  said.textContent = "click to zoom with the wheel";
  canvas.after(said);
  setTimeout(() => said.remove(), 3000);
}

function connectFullscreen() {
  const button = $("fullscreen");
  button.hidden = !document.fullscreenEnabled;
  button.addEventListener("click", () => (document.fullscreenElement ? document.exitFullscreen() : $("viewer").requestFullscreen()));
  document.addEventListener("fullscreenchange", () => {
    button.setAttribute("aria-pressed", String(document.fullscreenElement === $("viewer")));
    invalidate();
  });
}
