// Regions of the wall: whole numbers as colours, with a list of names in place of the colour bar.

function showRegions(field) {
  const names = field ? field.names : [];
  shared.coded.value = names.length > 0;
  const present = new Set(names.length ? panels.flatMap(({ mesh }) => codesOf(mesh, field.key)) : []);
  $("region-names").replaceChildren(...[...present].sort((a, b) => a - b).map((code) => regionName(field, code)));
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
