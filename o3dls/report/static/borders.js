// Borders of classes are drawn through the triangles, not along them: the share of a class goes smoothly from 1 to 0 across its border, and each pixel has the class with the largest share. Regions are such classes, and so is wall without a value. drawing/painting.py has the same rule.

const SOFTENED = 3; // rings of vertices over which shares change
const CLASSES_EACH = 4; // of an attribute of materials.js, which has `shares0` to `shares3`
const classed = new WeakMap(); // of each geometry the field whose classes its shares are

// From the values of a surface, where MISSING stands for none, what its colours are drawn by: `shade`, continued across the border, and `known`.
function softenMissing(geometry) {
  const values = geometry.getAttribute("value").array;
  const index = geometry.index.array;
  const has = Float32Array.from(values, (value) => (value > -1e20 ? 1 : 0));
  const bordered = has.includes(0) && has.includes(1);
  setArray(geometry, "shade", bordered ? continued(index, values, has) : values.slice());
  setArray(geometry, "known", bordered ? softened(index, has) : has);
}

// The shares of the classes of a field, whose values are whole numbers; kept while the field stays the same.
function softenClasses(geometry, data) {
  if (classed.get(geometry) === data) return;
  classed.set(geometry, data);
  const codes = unpack(data).map(Math.round);
  const index = geometry.index.array;
  const shares = [0, 1, 2, 3].map(() => new Uint8Array(CLASSES_EACH * codes.length));
  for (const code of new Set(codes)) {
    const own = softened(index, Float32Array.from(codes, (one) => (one === code ? 1 : 0)));
    const [into, at] = [shares[Math.floor(code / CLASSES_EACH)], code % CLASSES_EACH];
    own.forEach((share, i) => { into[CLASSES_EACH * i + at] = Math.round(255 * share); });
  }
  shares.forEach((array, k) => setArray(geometry, `shares${k}`, array, CLASSES_EACH));
}

// The class with the largest share at a place of a triangle.
function classAt(geometry, corners, weights) {
  const shares = [0, 1, 2, 3].flatMap((k) => [0, 1, 2, 3].map((at) => {
    const { array } = geometry.getAttribute(`shares${k}`);
    return corners.reduce((sum, corner, n) => sum + weights[n] * array[CLASSES_EACH * corner + at], 0);
  }));
  return shares.indexOf(Math.max(...shares));
}

function softened(index, share) {
  let out = share;
  for (let ring = 0; ring < SOFTENED; ring++) {
    const around = meanAround(index, out);
    out = out.map((own, i) => (own + around[i]) / 2);
  }
  return out;
}

// The values, and beyond their border the mean of the neighbours that have one.
function continued(index, values, has) {
  const [out, there] = [values.slice(), has.slice()];
  for (let ring = 0; ring < SOFTENED; ring++) {
    const near = meanAround(index, out, there);
    near.forEach((value, i) => { if (!there[i] && value > -1e20) [out[i], there[i]] = [value, 1]; });
  }
  return out;
}

// Of each vertex, the mean of the values of its neighbours by their weights; MISSING where these are all 0.
function meanAround(index, values, weights = null) {
  const [sum, count] = [new Float64Array(values.length), new Float64Array(values.length)];
  const add = (into, from) => {
    const weight = weights ? weights[from] : 1;
    sum[into] += weight * values[from];
    count[into] += weight;
  };
  for (let f = 0; f < index.length; f += 3) {
    for (let k = 0; k < 3; k++) {
      add(index[f + k], index[f + ((k + 1) % 3)]);
      add(index[f + k], index[f + ((k + 2) % 3)]);
    }
  }
  return sum.map((total, i) => (count[i] ? total / count[i] : MISSING));
}
