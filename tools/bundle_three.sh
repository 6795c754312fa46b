#!/bin/sh
# Rebuild o3dls/report/vendor/three.min.js: the part of three.js that the report uses, as one file. Needs node and npm; users of o3dls need neither.
#   sh tools/bundle_three.sh            from the project's root
set -eu
three=0.187.0 esbuild=0.28.2
out=$(pwd)/o3dls/report/vendor
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"
npm init -y >/dev/null
npm install --no-audit --no-fund "three@$three" "esbuild@$esbuild"
cat >entry.js <<'JS'
export {
  BackSide, BoxGeometry, BufferAttribute, BufferGeometry, DataTexture, DoubleSide, FrontSide, IcosahedronGeometry, InstancedBufferAttribute, InstancedMesh,
  LinearFilter, LinearSRGBColorSpace, Matrix4, Mesh, OctahedronGeometry, OrthographicCamera, Scene, ShaderMaterial,
  Vector3, Vector4, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
JS
npx esbuild entry.js --bundle --minify --format=iife --global-name=THREE --legal-comments=inline --outfile="$out/three.min.js"
cp node_modules/three/LICENSE "$out/three.LICENSE.txt"
