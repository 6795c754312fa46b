// Any estimate of the run in any panel: a select in the caption.

function estimateSelect(panel) {
  const select = document.createElement("select");
  select.className = "estimate";
  select.setAttribute("aria-label", `Estimate in picture ${panel.index + 1}`);
  scene.estimates.forEach(({ name }, k) => option(select, k, name));
  select.value = panel.estimate;
  panel.choice = select;
  select.addEventListener("change", () => showEstimate(panel, Number(select.value)));
  return select;
}

function showEstimate(panel, k) {
  setEstimate(panel, k);
  colourPanel(panel);
  panels.forEach(noteColour); // what others offer may be shown now
  showRegions(settings.field);
  listWorst();
  cut(); // its contours, its legend and the points
  refreshReadout();
}

// Make a panel that of an estimate, but for its colours and points.
function setEstimate(panel, k) {
  const { ghosts, ...own } = scene.estimates[k];
  Object.assign(panel, own, { estimate: k, geometry: geometryOf(own.mesh) });
  panel.sides.forEach((side) => { side.geometry = panel.geometry; });
  for (const [name, { matrix }] of Object.entries(ghosts)) if (matrix) panel.ghosts[name].matrix.set(...matrix);
  panel.canvas.setAttribute("aria-label", `${own.name}: surface in 3D. Drag or arrow keys turn it, + and - zoom, 0 resets.`);
  if (panel.choice) {
    panel.choice.value = k;
    followFit(panel, k);
  }
  if (panel.switch) panel.switch.lastChild.textContent = ` ${own.name}`;
}

// Of panels with one estimate the first that is shown: their contour is one.
const firstOf = (panel) => panels.find((one) => one.shown && one.estimate === panel.estimate) === panel;
