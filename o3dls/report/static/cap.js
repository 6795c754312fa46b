// The section of a cut, filled with lines that no wall has: the inside of the chamber is not taken for wall.

const CAP_FRAGMENT = `
  void main() {
    float line = smoothstep(0.6, 1.4, abs(mod(gl_FragCoord.x - gl_FragCoord.y, 7.0) - 3.5));
    gl_FragColor = vec4(mix(vec3(0.66), vec3(0.86), line), 1.0);
  }`;
const CAP_VERTEX = "void main() { gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }";
const CAP_ORDER = 10; // after all that is opaque

// Triangles from one place to every line of an outline invert what they cover: odd is inside.
const capMaterials = [
  { colorWrite: false, depthTest: false, stencilFunc: webgl.ALWAYS, stencilZPass: webgl.INVERT },
  { depthTest: true, stencilFunc: webgl.NOTEQUAL, stencilZPass: webgl.ZERO },
].map((own) => new THREE.ShaderMaterial({
  vertexShader: CAP_VERTEX, fragmentShader: CAP_FRAGMENT, side: THREE.DoubleSide, depthWrite: false, stencilWrite: true, stencilRef: 0, ...own,
}));

// The cap of a panel's own contour; a translucent wall has none, so that one looks inside.
function capPanel(panel) {
  panel.cap?.forEach((mesh) => panel.world.remove(mesh));
  panel.cap?.[0].geometry.dispose();
  panel.cap = null;
  const own = contours.find(({ geometry, matrix }) => geometry === panel.geometry && !matrix);
  if (!own?.segments.length || shared.opacity.value < 1) return;
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(fanOf(own.segments)), 3));
  panel.cap = capMaterials.map((material, k) => {
    const mesh = new THREE.Mesh(geometry, material);
    mesh.renderOrder = CAP_ORDER + k;
    mesh.frustumCulled = false;
    panel.world.add(mesh);
    return mesh;
  });
}

// A triangle for each segment, and one that closes each line of them, which may break where two ends are rounded apart.
function fanOf(segments) {
  const out = [];
  const anchor = [...segments.subarray(0, 3)];
  let begin = anchor;
  for (let i = 0; i < segments.length; i += 6) {
    const [from, to] = [[...segments.subarray(i, i + 3)], [...segments.subarray(i + 3, i + 6)]];
    out.push(...anchor, ...from, ...to);
    const goesOn = i + 6 < segments.length && to.every((at, k) => at === segments[i + 6 + k]);
    if (goesOn) continue;
    out.push(...anchor, ...to, ...begin);
    begin = [...segments.subarray(i + 6, i + 9)];
  }
  return out;
}

// Whether a cap stands before the wall: what was taken away is entered more often than it is left.
function isCapped({ forward }, taken) {
  const { x, y, z } = shared.plane.value;
  return taken % 2 === 1 && shared.opacity.value === 1 && x * forward.x + y * forward.y + z * forward.z < 0;
}
