"""Parts of a page that come from files: styles, scripts, pictures."""

from __future__ import annotations

import base64
from importlib.resources import files

from .markup import Html, data_block, join, tag

SCRIPTS = (
    "decode.js",
    "borders.js",
    "materials.js",
    "focus.js",
    "framing.js",
    "cube.js",
    "panels.js",
    "points.js",
    "hidden.js",
    "overlay.js",
    "controls.js",
    "labels.js",
    "bars.js",
    "handles.js",
    "regions.js",
    "next.js",
    "torso.js",
    "estimates.js",
    "plane.js",
    "cap.js",
    "hit.js",
    "pick.js",
    "measure.js",
    "worst.js",
    "picture.js",
    "pair.js",
    "motion.js",
    "link.js",
    "start.js",
)


def asset(name: str, folder: str = "static") -> str:
    """Read the text of a file that comes with the report."""
    return (files("o3dls.report") / folder / name).read_text(encoding="utf-8")


def viewer_code() -> tuple[str, str]:
    """Return the scripts of the 3D viewer: three.js, and ours in one scope."""
    library = f"/* three.js\n{asset('three.LICENSE.txt', 'vendor')}*/\n{asset('three.min.js', 'vendor')}"
    return library, f'"use strict";\n{viewer_started()};'


def viewer_started(more: str = "", given: str = "undefined") -> str:
    """Write the expression that starts the viewer, which may run once the page holds its markup and its
    scene.

    `more` is code in its scope, run before it paints for the first time; `given` is what the expression gives
    afterwards: undefined where there is no WebGL.
    """
    *parts, start = map(asset, SCRIPTS)
    ours = "\n".join([*parts, more, start, f"return {given};"])
    # without WebGL the static pictures stay; a context is slow to make, so the one that tells draws too
    # and it keeps what it drew, since a driver may copy a picture later than it is asked to
    settings = "{ antialias: true, alpha: true, stencil: true, preserveDrawingBuffer: true }"
    context = f"document.createElement('canvas').getContext('webgl2', {settings})"
    return f"((webgl) => {{\nif (!webgl) return undefined;\n{ours}\n}})({context})"


def viewer_scripts(scene: object) -> Html:
    """Return the 3D viewer's markup, its data, and its scripts."""
    code = (tag("script", Html(text)) for text in viewer_code())
    return join(Html(asset("viewer.html")), data_block("scene", scene), *code)


def image(png: bytes, description: str, *children: Html) -> Html:
    """Write a picture into the page, as part of the file, with what belongs to it."""
    source = "data:image/png;base64," + base64.b64encode(png).decode("ascii")
    return tag("figure", tag("img", src=source, alt=description), *children)
