// What the page carries: meshes, fields and points as base64 arrays, written by scene.py.

const scene = JSON.parse(document.getElementById("scene").textContent);
const MISSING = -1e30; // a value that no field has; the shader paints it grey

// `place` in the arrays of the page, each of which stands there once; or the array itself, which came later.
function bytes(place) {
  const raw = atob(typeof place === "string" ? place : scene.arrays[place]);
  const out = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) out[i] = raw.charCodeAt(i);
  return out;
}

const uint16 = (place) => new Uint16Array(bytes(place).buffer);
const uint32 = (place) => new Uint32Array(bytes(place).buffer);

// Numbers stored in 16 bits between low and high; 65535 stands for a missing value.
function unpack({ data, low, high }) {
  const packed = uint16(data);
  const step = (high - low) / 65534;
  const out = new Float32Array(packed.length);
  for (let i = 0; i < packed.length; i++) out[i] = packed[i] === 65535 ? MISSING : low + packed[i] * step;
  return out;
}

// Coordinates stored in 16 bits inside the scene's box, so all meshes share one grid.
function unpackPositions(data, { low, size } = scene.box) {
  const packed = uint16(data);
  const out = new Float32Array(packed.length);
  for (let i = 0; i < packed.length; i++) out[i] = low[i % 3] + (packed[i] * size[i % 3]) / 65535;
  return out;
}

function decodeMesh(mesh) {
  const geometry = new THREE.BufferGeometry();
  const faces = mesh.wide ? uint32(mesh.faces) : uint16(mesh.faces);
  geometry.setAttribute("position", new THREE.BufferAttribute(unpackPositions(mesh.positions), 3));
  geometry.setAttribute("occlusion", new THREE.BufferAttribute(bytes(mesh.occlusion), 1, true));
  geometry.setIndex(new THREE.BufferAttribute(faces, 1));
  geometry.computeVertexNormals();
  return geometry;
}
