"""The section of the report with contours on the image: three stacks, each with a slider."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence

from ...errors import InputError
from ..drawing.slices import Frame, decoration, write_path
from ..markup import Html, join, tag
from ..section import Section
from ..subject import Subject
from .brought import Brought, brought_back
from .stack import BESIDE, COUNT, Cut, Grey, Stack, Stacks, make_stacks

QUALITIES = (85, 75, 60, 40, 20)  # of 100, of the pictures: the first by which they are small enough
MOST_BYTES = 780_000  # of all pictures; they take a third more as text, and contours up to 0.4 MB
THIN = 0.1  # pixels of the picture: corners of a contour that stand off less are left out
HIDDEN = "none"
STEPS = 256  # of the sliders of window and level


def image_section(subject: Subject) -> Section | None:
    """Draw contours on the image of the prior; None for a case that has none."""
    if not subject.case.image:
        return None
    try:
        brought = brought_back(subject)
        stacks = make_stacks(brought)
    except InputError as error:
        said = f"No contours on the image: {error}. With o3dls slices RUN --image FILE they are drawn anyway."
        return Section("image", "On the image", tag("p", said, class_="soft"))
    pictures = _encode_pictures(stacks)
    drawn = [
        _stack_figure(stack, brought, pictures[k * COUNT : (k + 1) * COUNT])
        for k, stack in enumerate(stacks.stacks)
    ]
    figures = tag("div", *drawn, class_="charts")
    body = tag("div", _tools(brought, stacks), figures, _note(subject, brought), class_="stacks")
    return Section("image", "On the image", body, scripts=("stacks.js",), styles=("stacks.css",))


def _note(subject: Subject, brought: Brought) -> Html:
    kind = "label volume of the prior" if brought.labels else "image of the prior"
    said = (
        f"The {kind}, {brought.image.path.name}, in {COUNT} slices along each axis, closer together where "
        "the result differs from the prior and where points lie. What was found on the map is brought back "
        f"to the image: by the inverse of the similarity of {subject.last.name}, which leaves its shape, or "
        "by the inverse of its motion, which brings the moved prior back onto the prior. Dots: eam points "
        f"within {BESIDE:g} mm of the slice, brought back by the motion. Axes: {brought.seen.known_by}."
    )
    if gap := brought.image.gap(brought.prior.vertices):
        said += f" The image {gap}."
    return tag("p", said, class_="soft")


def _tools(brought: Brought, stacks: Stacks) -> Html:
    """Return what switches lines and changes the window; the sliders appear where scripts run."""
    names = {layer.key: layer.name for layer in brought.layers} | {"points": "points"}
    switches = [
        tag(
            "label",
            tag("input", type="checkbox", checked=True, data_layer=key, hidden=True),
            _swatch(key),
            name,
        )
        for key, name in names.items()
    ]
    low, high = stacks.range
    first = {"window": stacks.window[1] - stacks.window[0], "level": sum(stacks.window) / 2}
    ends = {"window": ((high - low) / STEPS, high - low), "level": (low, high)}
    sliders = [
        tag(
            "label",
            name,
            tag(
                "input",
                type="range",
                min=f"{ends[key][0]:.6g}",
                max=f"{ends[key][1]:.6g}",
                step="any",
                value=f"{first[key]:.6g}",
                data_grey=key,
            ),
            tag("output", f"{first[key]:.4g}"),
        )
        for key, name in (("window", "Window"), ("level", "Level"))
    ]
    grey = tag("div", *sliders, class_="grey", hidden=True, data_low=f"{low:.9g}", data_high=f"{high:.9g}")
    return join(tag("div", *switches, class_="lines"), grey, _filter(stacks))


def _swatch(key: str) -> Html:
    if key == "points":
        mark = tag("circle", cx=14, cy=6, r=3.5, class_="point")
    else:
        mark = tag("path", d="M1 6H27", class_=f"line {key}")
    return tag("svg", mark, viewBox="0 0 28 12", width=28, height=12, aria_hidden="true", class_="swatch")


def _filter(stacks: Stacks) -> Html:
    """Return the filter that makes grey values of a picture black and white at the ends of the window."""
    low, high = stacks.range
    slope = (high - low) / (stacks.window[1] - stacks.window[0])
    intercept = -slope * (stacks.window[0] - low) / (high - low)
    channels = [
        tag(f"feFunc{channel}", type="linear", slope=f"{slope:.5g}", intercept=f"{intercept:.5g}")
        for channel in "RGB"
    ]
    transfer = tag("feComponentTransfer", *channels)
    found = tag(
        "filter", transfer, id="grey-window", color_interpolation_filters="sRGB", x=0, y=0, width=1, height=1
    )
    return tag("svg", found, width=0, height=0, aria_hidden="true", class_="filter")


def _stack_figure(stack: Stack, brought: Brought, pictures: Sequence[bytes]) -> Html:
    middle = len(stack.cuts) // 2
    names = [stack.name(cut) for cut in stack.cuts]
    title = stack.title(patient=brought.seen.patient)
    groups = [
        tag(
            "g",
            *_draw_cut(stack.frame, cut, pictures[k]),
            class_="cut",
            data_said=names[k],
            display=None if k == middle else HIDDEN,
        )
        for k, cut in enumerate(stack.cuts)
    ]
    width, height = stack.frame.size
    picture = tag(
        "svg",
        *groups,
        *decoration(stack.frame),
        viewBox=f"0 0 {width:.0f} {height:.0f}",
        class_="chart slice",
        role="img",
        aria_label=f"{title}: {', '.join(layer.name for layer in brought.layers)}, on the image",
    )
    slider = tag(
        "label",
        "Slice",
        tag("input", type="range", min=1, max=len(stack.cuts), value=middle + 1, step=1, hidden=True),
        class_="which",
    )
    said = tag("figcaption", slider, tag("output", f"{middle + 1} of {len(stack.cuts)}: {names[middle]}"))
    return tag("figure", tag("h3", title), picture, said, class_="plot stack")


def _draw_cut(frame: Frame, cut: Cut, jpeg: bytes) -> list[Html]:
    (left, below), (right, above) = frame.place(frame.low), frame.place(frame.high)
    picture = tag(
        "image",
        href="data:image/jpeg;base64," + base64.b64encode(jpeg).decode("ascii"),
        x=f"{left:.1f}",
        y=f"{above:.1f}",
        width=f"{right - left:.1f}",
        height=f"{below - above:.1f}",
        preserveAspectRatio="none",
        filter="url(#grey-window)",
    )
    lines = [
        tag("path", d=write_path(frame.place(segments), THIN), class_=f"line {key}")
        for key, segments in cut.outlines.items()
        if len(segments)
    ]
    seen = frame.place(cut.points[frame.holds(cut.points)])
    dots = [tag("circle", cx=f"{x:.1f}", cy=f"{y:.1f}", r=3, class_="point") for x, y in seen]
    return [picture, *lines, *dots]


def _encode_pictures(stacks: Stacks) -> list[bytes]:
    """Encode the pictures of all slices, with less quality where noise makes them large."""
    every = [cut.pixels for stack in stacks.stacks for cut in stack.cuts]
    for quality in QUALITIES:
        found = [_encode_jpeg(pixels, quality) for pixels in every]
        if sum(map(len, found)) <= MOST_BYTES:
            break
    return found


def _encode_jpeg(pixels: Grey, quality: int) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="JPEG", quality=quality, optimize=True)
    return buffer.getvalue()
