// How surfaces and points are painted: one table of colours, a light at the camera, a cut plane, and grey or hatching where nothing is known.

const VERTEX = `
  attribute float shade; // these by borders.js
  attribute float known;
  attribute vec4 shares0;
  attribute vec4 shares1;
  attribute vec4 shares2;
  attribute vec4 shares3;
  attribute float remoteness;
  attribute float occlusion; // share of the light from outside that other wall keeps away, by occlusion.py
  varying vec3 vNormal;
  varying vec3 vPosition;
  varying float vValue;
  varying float vKnown;
  varying vec4 vShares[4];
  varying float vRemoteness;
  varying float vOcclusion;
  void main() {
    vKnown = known;
    vShares[0] = shares0;
    vShares[1] = shares1;
    vShares[2] = shares2;
    vShares[3] = shares3;
    vOcclusion = occlusion;
    vNormal = normalMatrix * normal;
    vPosition = (modelMatrix * vec4(position, 1.0)).xyz;
    vValue = shade;
    vRemoteness = remoteness;
    gl_Position = projectionMatrix * viewMatrix * vec4(vPosition, 1.0);
  }`;

// Colours are read by their lightness, so light takes little of it, as raster.py does: a dark line where the wall turns away shows the shape.
const FRAGMENT = `
  #define FLOOR 0.85
  #define INSIDE_LIGHT 0.93
  #define SHADE 0.5
  uniform sampler2D colours;
  uniform vec2 range;
  uniform vec3 plain;
  uniform bool mapped;
  uniform bool coded;
  uniform bool hatched;
  uniform float far;
  uniform float opacity;
  uniform float isochrones;
  uniform vec3 outline;
  uniform float outlined; // pixels of a line in this colour where the wall turns away
  uniform vec4 plane;
  varying vec3 vNormal;
  varying vec3 vPosition;
  varying float vValue;
  varying float vKnown;
  varying vec4 vShares[4];
  varying float vRemoteness;
  varying float vOcclusion;
  vec3 colourOf(float value) {
    float t = clamp((value - range.x) / max(range.y - range.x, 1e-12), 0.0, 1.0);
    return texture2D(colours, vec2((t * 255.0 + 0.5) / 256.0, 0.5)).rgb;
  }
  // The share of a pixel that lies on that side of a border where beyond is above 0.
  float sideOf(float beyond) {
    return clamp(0.5 + beyond / max(fwidth(beyond), 1e-6), 0.0, 1.0);
  }
  vec3 colourOfClass() {
    vec2 most = vec2(-1.0); // the two largest shares, and the classes that have them
    vec2 which = vec2(0.0);
    for (int k = 0; k < 16; k++) {
      float share = vShares[k / 4][k % 4];
      if (share > most.x) { most = vec2(share, most.x); which = vec2(float(k), which.x); }
      else if (share > most.y) { most.y = share; which.y = float(k); }
    }
    return mix(colourOf(which.y), colourOf(which.x), sideOf(most.x - most.y));
  }
  void main() {
    if (dot(vPosition, plane.xyz) > plane.w) discard;
    float facing = abs(normalize(vNormal).z);
    bool bare = !mapped || vKnown < 0.5; // grey, on which lines in its own grey would not show
    vec3 colour = coded ? colourOfClass() : colourOf(vValue);
    colour = mix(plain, colour, mapped ? sideOf(vKnown - 0.5) : 0.0);
    float count = vValue / max(isochrones, 1e-6);
    float wide = fwidth(count); // steps per pixel: where lines would merge there are none
    bool line = wide < 0.4 && abs(fract(count + 0.5) - 0.5) < 0.8 * wide;
    if (!bare && isochrones > 0.0 && line) colour = vec3(0.08);
    if (hatched && vRemoteness > far && mod(gl_FragCoord.x + gl_FragCoord.y, 9.0) < 3.5) colour = mix(colour, vec3(bare ? 0.42 : 0.72), 0.8);
    float lit = 1.0 - (1.0 - facing) * (1.0 - facing);
    float light = mix(FLOOR, gl_FrontFacing ? 1.0 : INSIDE_LIGHT, lit);
    if (gl_FrontFacing) light = max(FLOOR, light - SHADE * vOcclusion);
    float steep = facing / max(fwidth(facing), 1e-6); // pixels to where the wall turns away
    float edge = gl_FrontFacing ? 1.0 - smoothstep(0.8, 2.2, steep) : 0.0;
    float rim = pow(1.0 - facing, 3.0);
    gl_FragColor = vec4(mix(colour * light, vec3(0.12), 0.8 * edge), mix(opacity, 1.0, opacity < 1.0 ? 0.6 * rim : 1.0));
    float drawn = outlined > 0.0 ? 1.0 - smoothstep(0.6 * outlined, outlined, steep) : 0.0;
    gl_FragColor = vec4(mix(gl_FragColor.rgb, outline, drawn), max(gl_FragColor.a, drawn));
  }`;

// A point is a flat mark that faces the viewer and has one size on the screen. `form`: 0 is round, 1 a square, 2 a diamond.
const MARK_VERTEX = `
  attribute vec3 tint;
  attribute float form;
  attribute float rank; // of those that are drawn where all would lie over each other
  uniform vec4 screen;
  uniform float radius; // both in pixels
  uniform float share;
  uniform float lift; // towards the viewer: a mark on the wall is not half sunk into it
  varying vec3 vTint;
  varying vec2 vBeside;
  varying float vForm;
  void main() {
    vTint = tint;
    vForm = form;
    vBeside = position.xy;
    vec4 centre = projectionMatrix * (modelViewMatrix * instanceMatrix * vec4(0.0, 0.0, 0.0, 1.0) + vec4(0.0, 0.0, lift, 0.0));
    gl_Position = rank > share ? vec4(2.0, 2.0, 2.0, 1.0) : centre + vec4((form > 1.5 ? 2.6 : 2.0) * radius * position.xy / screen.xy, 0.0, 0.0);
  }`;

const MARK_FRAGMENT = `
  varying vec3 vTint;
  varying vec2 vBeside;
  varying float vForm;
  void main() {
    vec2 at = abs(vBeside);
    float beyond = vForm < 0.5 ? length(at) : vForm < 1.5 ? 1.15 * max(at.x, at.y) : at.x + at.y;
    float soft = 0.35 * fwidth(beyond);
    float inside = 1.0 - smoothstep(1.0 - 2.0 * soft, 1.0, beyond);
    if (inside < 0.1) discard;
    vec3 rim = mix(vec3(1.0), vec3(0.25), smoothstep(0.92 - soft, 0.92 + soft, beyond)); // seen on a wall of any colour
    gl_FragColor = vec4(mix(vTint, rim, smoothstep(0.56 - soft, 0.56 + soft, beyond)), inside);
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
    uniforms: { ...shared, plain: { value: new THREE.Vector3(0.72, 0.72, 0.74) }, outline: { value: new THREE.Vector3() }, outlined: { value: 0 }, ...uniforms },
    side,
  });
}

// Pixels of the pictures and what depends on them; set before each is drawn.
const marks = { screen: { value: new THREE.Vector4() }, radius: { value: 1 }, share: { value: 1 }, lift: { value: 1.2 } };
const markMaterial = new THREE.ShaderMaterial({ vertexShader: MARK_VERTEX, fragmentShader: MARK_FRAGMENT, uniforms: marks, transparent: true });

// The colour of a value in a map, as [r, g, b] in 0..1.
function colourOf(map, value, low, high) {
  if (!(value > -1e20)) return [0.6, 0.6, 0.6];
  const rgba = textures[map].image.data;
  const k = 4 * Math.round(255 * Math.min(1, Math.max(0, (value - low) / Math.max(high - low, 1e-12))));
  return [rgba[k] / 255, rgba[k + 1] / 255, rgba[k + 2] / 255];
}
