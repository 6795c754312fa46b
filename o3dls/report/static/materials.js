// How surfaces and balls are painted: one table of colours, a light at the camera, a cut plane, and grey or hatching where nothing is known.

const VERTEX = `
  attribute float value;
  attribute float remoteness;
  varying vec3 vNormal;
  varying vec3 vPosition;
  varying float vValue;
  flat varying float vCode;
  varying float vRemoteness;
  void main() {
    vNormal = normalMatrix * normal;
    vPosition = (modelMatrix * vec4(position, 1.0)).xyz;
    vValue = vCode = value;
    vRemoteness = remoteness;
    gl_Position = projectionMatrix * viewMatrix * vec4(vPosition, 1.0);
  }`;

const FRAGMENT = `
  uniform sampler2D colours;
  uniform vec2 range;
  uniform vec3 plain;
  uniform bool mapped;
  uniform bool coded;
  uniform bool hatched;
  uniform float far;
  uniform float opacity;
  uniform float isochrones;
  uniform vec4 plane;
  varying vec3 vNormal;
  varying vec3 vPosition;
  varying float vValue;
  flat varying float vCode;
  varying float vRemoteness;
  void main() {
    if (dot(vPosition, plane.xyz) > plane.w) discard;
    float facing = abs(normalize(vNormal).z);
    vec3 colour = plain;
    float value = coded ? vCode : vValue;
    if (mapped && value > -1e20) {
      float t = clamp((value - range.x) / max(range.y - range.x, 1e-12), 0.0, 1.0);
      colour = texture2D(colours, vec2((t * 255.0 + 0.5) / 256.0, 0.5)).rgb;
    }
    float count = vValue / max(isochrones, 1e-6);
    float wide = fwidth(count); // steps per pixel: where lines would merge there are none
    bool line = wide < 0.4 && abs(fract(count + 0.5) - 0.5) < 0.8 * wide;
    if (mapped && isochrones > 0.0 && vValue > -1e20 && line) colour = vec3(0.08);
    if (hatched && vRemoteness > far && mod(gl_FragCoord.x + gl_FragCoord.y, 9.0) < 3.5) colour = mix(colour, vec3(0.72), 0.8);
    if (!gl_FrontFacing) colour = mix(colour, vec3(0.35), 0.35);
    float rim = pow(1.0 - facing, 3.0);
    gl_FragColor = vec4(colour * (0.5 + 0.5 * facing), mix(opacity, 1.0, opacity < 1.0 ? 0.6 * rim : 1.0));
  }`;

const BALL_VERTEX = `
  attribute vec3 tint;
  varying vec3 vNormal;
  varying vec3 vTint;
  varying vec2 vBeside;
  void main() {
    vNormal = normalMatrix * normal;
    vTint = tint;
    vBeside = (mat3(modelViewMatrix) * position).xy;
    gl_Position = projectionMatrix * modelViewMatrix * instanceMatrix * vec4(position, 1.0);
  }`;

const BALL_FRAGMENT = `
  varying vec3 vNormal;
  varying vec3 vTint;
  varying vec2 vBeside;
  uniform float rim; // from so far beside the centre the ball is white
  void main() {
    vec3 colour = vTint * (0.45 + 0.55 * abs(normalize(vNormal).z));
    gl_FragColor = vec4(length(vBeside) > rim ? vec3(1.0) : colour, 1.0);
  }`;

function colourTexture(name) {
  const rgb = bytes(scene.maps[name]);
  const rgba = new Uint8Array(1024).fill(255);
  for (let i = 0; i < 256; i++) rgba.set(rgb.subarray(3 * i, 3 * i + 3), 4 * i);
  const texture = new THREE.DataTexture(rgba, 256, 1);
  texture.minFilter = texture.magFilter = THREE.LinearFilter;
  texture.needsUpdate = true;
  return texture;
}

const textures = Object.fromEntries(Object.keys(scene.maps).map((name) => [name, colourTexture(name)]));

// One set of uniforms for all panels: what is changed once is changed everywhere.
const shared = {
  colours: { value: textures.sequential },
  range: { value: [0, 1] },
  mapped: { value: true },
  coded: { value: false }, // the values are numbers of regions: none lies between two
  hatched: { value: true },
  far: { value: scene.far },
  opacity: { value: 1 },
  isochrones: { value: 0 }, // of the chosen field, in its unit; 0: none
  plane: { value: new THREE.Vector4(0, 0, 0, 1) },
};

function surfaceMaterial(side, uniforms = {}) {
  return new THREE.ShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    uniforms: { ...shared, plain: { value: new THREE.Vector3(0.72, 0.72, 0.74) }, ...uniforms },
    side,
  });
}

const ballMaterial = (rim) => new THREE.ShaderMaterial({ vertexShader: BALL_VERTEX, fragmentShader: BALL_FRAGMENT, uniforms: { rim: { value: rim } } });

// The colour of a value in a map, as [r, g, b] in 0..1.
function colourOf(map, value, low, high) {
  if (!(value > -1e20)) return [0.6, 0.6, 0.6];
  const rgba = textures[map].image.data;
  const k = 4 * Math.round(255 * Math.min(1, Math.max(0, (value - low) / Math.max(high - low, 1e-12))));
  return [rgba[k] / 255, rgba[k + 1] / 255, rgba[k + 2] / 255];
}
