// The border of wall without a value is drawn through the triangles, not along them: a share of what is known goes smoothly from 1 to 0 across it.

const SOFTENED = 3; // rings of vertices over which the share changes

// From the values of a surface, where MISSING stands for none, what its colours are drawn by: `shade`, continued across the border, and `known`.
function softenMissing(geometry) {
  const values = geometry.getAttribute("value").array;
  const index = geometry.index.array;
  const has = Float32Array.from(values, (value) => (value > -1e20 ? 1 : 0));
  const [shade, known] = [values.slice(), has.slice()];
  const bordered = has.includes(0) && has.includes(1);
  for (let ring = 0; bordered && ring < SOFTENED; ring++) {
    const near = meanAround(index, shade, has);
    const around = meanAround(index, known);
    for (let i = 0; i < known.length; i++) {
      known[i] = (known[i] + around[i]) / 2;
      if (!has[i] && near[i] > -1e20) [shade[i], has[i]] = [near[i], 1];
    }
  }
  setArray(geometry, "shade", shade);
  setArray(geometry, "known", known);
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
