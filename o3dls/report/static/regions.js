// What stands below the colour bars: names of the regions of the wall, whose whole numbers are colours, and what hatching, grey and diamonds mean.

function showRegions(field) {
  const names = field ? field.names : [];
  shared.coded.value = names.length > 0;
  const present = new Set(names.length ? panels.flatMap(({ mesh }) => codesOf(mesh, field.key)) : []);
  $("region-names").replaceChildren(...[...present].sort((a, b) => a - b).map((code) => regionName(field, code)));
}

// What hatching, plain grey and diamonds mean, where any of the wall and the points that are shown have them.
function explainWall() {
  const shown = panels.filter((panel) => panel.shown);
  const some = (name, found) => shown.some(({ geometry }) => geometry.getAttribute(name).array.some(found));
  const hatched = Boolean(scene.remoteness) && shared.hatched.value;
  $("means-hatched").hidden = !(hatched && some("remoteness", (far) => far > shared.far.value));
  $("means-grey").hidden = !(settings.field && some("value", (value) => value < -1e20));
  $("means-diamond").hidden = !(settings.kinds.outliers && shown.some((panel) => panel.rows.some((i) => isOutlier(panel, i))));
  $("wall-legend").hidden = [...$("wall-legend").children].every((one) => one.hidden);
}

function codesOf(mesh, key) {
  const data = scene.meshes[mesh].fields[key];
  return data ? [...new Set(unpack(data))].map(Math.round) : [];
}

function regionName(field, code) {
  const item = document.createElement("span");
  const patch = document.createElement("i");
  const [low, high] = field.range;
  const rgb = colourOf(field.map, code, low, high).map((part) => Math.round(255 * part));
  patch.style.borderTop = `.7em solid rgb(${rgb.join(",")})`;
  item.append(patch, field.names[code]);
  return item;
}
