// The fitted points that are farthest from the estimate in the last panel; outliers come after all that are believed, since they are known to be far.

const MOST_WORST = 10;

function worstPoints({ estimate, fitted }) {
  const [distance, outlier] = [cloud.residuals[estimate], cloud.outliers[estimate]];
  return [...cloud.kinds.keys()]
    .filter((i) => fitted.includes(kindOf(i)) && distance[i] > -1e20)
    .sort((i, j) => outlier[i] - outlier[j] || distance[j] - distance[i])
    .slice(0, MOST_WORST);
}

function listWorst() {
  const panel = panels[panels.length - 1];
  const rows = worstPoints(panel);
  $("worst").hidden = !rows.length;
  $("worst-name").textContent = panel.name;
  $("worst-rows").replaceChildren(...rows.map((i) => worstRow(panel, i)));
}

function worstRow(panel, i) {
  const belief = cloud.beliefs[panel.estimate][i];
  const row = document.createElement("tr");
  const name = document.createElement("th");
  Object.assign(name, { scope: "row", textContent: scene.points.ids[i] || cloud.rows[i] });
  row.append(name);
  const cells = [kindOf(i), withUnit(cloud.residuals[panel.estimate][i], scene.units), belief > -1e20 ? belief.toFixed(2) : "–"];
  cells.forEach((text) => { row.insertCell().textContent = text; });
  button(row.insertCell(), "Look", () => lookAtPoint(panel, i));
  row.querySelector("button").setAttribute("aria-label", `Look at ${nameOf(i)}`);
  return row;
}

// From outside: along the normal of the wall where the point is nearest to it.
function lookAtPoint(panel, i) {
  const at = placeOf(i);
  const position = panel.geometry.getAttribute("position");
  const place = new THREE.Vector3();
  let [nearest, least] = [0, Infinity];
  for (let k = 0; k < position.count; k++) {
    const gap = place.fromBufferAttribute(position, k).distanceToSquared(at);
    if (gap < least) [nearest, least] = [k, gap];
  }
  const outward = place.fromBufferAttribute(panel.geometry.getAttribute("normal"), nearest);
  if (Math.abs(outward.dot(camera.up)) > 0.999) outward.addScaledVector(new THREE.Vector3(...scene.views[0].from), 0.05); // so that what is up is defined
  lookFrom(outward.toArray());
  panel.canvas.scrollIntoView({ block: "nearest" });
  pin({ panel, point: i, at });
}
