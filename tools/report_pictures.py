"""Draw the pictures of docs/report.md in Chromium: a page of the demo, and where it is given a page of a
cohort. What the first screen says is written beside them, so that a test notices when it is no longer so.

    o3dls demo --out o3dls_demo
    for seed in 11 12 13 14; do python -m data_synth atrium cases/atrium_$seed --seed $seed; done
    o3dls batch 'cases/*' --out runs
    python tools/report_pictures.py o3dls_demo/report.html docs [runs/cohort.html]

Needs playwright (the extra `test`) and a Chromium.
"""

from __future__ import annotations

import io
import json
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw, ImageFont, ImageOps
from playwright.sync_api import Page, sync_playwright

from o3dls import __version__

WIDTH, HEIGHT = 1200, 880  # of the window, and the most that a picture of the docs may have
SMALL = 760  # pixels across of a picture that would be too tall
RED = "#b00020"
RADIUS = 11  # of a number's disc, pixels
PASSES = 3  # over the palette, without which the few pixels of a legend get the colour of something else
PANEL = 245  # of 255, the brightest of a panel: what is brighter is the page
SHOWN = "report_shown.json"  # what the pictures of the first screen say
ROOM = 24  # pixels around a part of the page, for the discs
ARGUMENTS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")

# what has a number; the lists in docs/report.md have the same order
FIRST_SCREEN = (
    "h1",
    "header .overall",
    "header .answers",
    "header .strip",
    "header p.soft",
    "nav.contents",
    ".panel",
    "#panels figure",
    "#panels figure:nth-of-type(2)",
)
VIEWER = (
    "label:has(#field)",
    "#views button",
    "label:has(#translucent)",
    "label:has(#ghost)",
    "label:has(#cut)",
    "#measure",
    "#shown",
    "#pair",
    "#kinds label",
    "#torso",
    "#panels select.estimate",
    "#readout",
    "#surface-bar",
    "#point-bar",
    "#worst",
)


def first_screen(page: Page) -> Image.Image:
    page.evaluate("scrollTo(0, 0)")
    return numbered(shot(page), page, FIRST_SCREEN, (0.0, 0.0))


def viewer(page: Page) -> Image.Image:
    seen = box(page, "#viewer")
    return numbered(part(page, "#viewer"), page, VIEWER, (seen["x"] - ROOM, seen["y"] - ROOM))


def before_after(page: Page) -> Image.Image:
    page.locator("#pair").click()
    page.locator("#divider").focus()
    found = part(page, "#panels")
    page.locator("#pair").click()
    return found


def readout(page: Page) -> Image.Image:
    """The first of the worst points, pinned, through a translucent wall."""
    page.locator("#translucent").fill("0.4")
    page.locator("#worst summary").click()
    page.get_by_role("button", name="Look at").first.click()
    found = part(page, "#panels", "#readout")
    page.keyboard.press("Escape")
    page.locator("#worst summary").click()
    page.locator("#translucent").fill("0")
    page.get_by_role("button", name="Reset", exact=True).click()
    return found


def next_places(page: Page) -> Image.Image:
    """The wall from the right in the colours of its regions, with the numbers, and the section's table."""
    before = page.input_value("#field")
    page.select_option("#field", "region")
    page.get_by_role("button", name="RL", exact=True).click()
    pictures = part(page, "#panels", "#wall-legend")
    page.select_option("#field", before)
    return stacked(pictures, part(page, "#next"))


def slices(page: Page) -> Image.Image:
    """Three planes in two rows, which are tall."""
    found = part(page, "#slices")
    return found.resize((SMALL, round(SMALL * found.height / found.width)), Image.Resampling.LANCZOS)


def section(anchor: str) -> Callable[[Page], Image.Image]:
    return lambda page: part(page, f"#{anchor}")


PICTURES: Mapping[str, Callable[[Page], Image.Image]] = {
    "first_screen": first_screen,
    "strip": lambda page: part(page, "header .strip"),
    "viewer": viewer,
    "before_after": before_after,
    "readout": readout,
    "next": next_places,
    "contributions": section("contributions"),
    "calibration": section("calibration"),
    "slices": slices,
}


def settle(page: Page) -> None:
    page.wait_for_timeout(1500)  # a renderer in software takes a while to draw anew


def shot(page: Page) -> Image.Image:
    settle(page)
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def part(page: Page, first: str, last: str | None = None) -> Image.Image:
    """An element, or all from one to the last, with some room around."""
    settle(page)
    boxes = [box(page, name) for name in filter(None, (first, last))]
    left, top = boxes[0]["x"], boxes[0]["y"]
    right, bottom = (
        max(one[at] + one[size] for one in boxes) for at, size in (("x", "width"), ("y", "height"))
    )
    clip = {"x": left, "y": top, "width": right - left, "height": bottom - top}
    found = Image.open(io.BytesIO(page.screenshot(full_page=True, clip=clip))).convert("RGB")
    return ImageOps.expand(found, ROOM, "white")


def box(page: Page, selector: str) -> Any:
    """Place and size of an element on the whole page, in pixels."""
    script = """one => { const { x, y, width, height } = one.getBoundingClientRect();
        return { x: x + scrollX, y: y + scrollY, width, height }; }"""
    return page.locator(selector).first.evaluate(script)


def numbered(
    picture: Image.Image, page: Page, marks: Sequence[str], origin: tuple[float, float]
) -> Image.Image:
    """Numbers from 1 in discs beside elements; `origin`: the upper left corner of the picture on the page."""
    draw = ImageDraw.Draw(picture)
    font = ImageFont.load_default(size=14)
    for number, selector in enumerate(marks, 1):
        at = box(page, selector)
        x, y = at["x"] - origin[0] - RADIUS + 2, at["y"] - origin[1] + 1
        draw.ellipse((x - RADIUS, y - RADIUS, x + RADIUS, y + RADIUS), fill=RED, outline="white", width=2)
        draw.text((x, y), str(number), fill="white", font=font, anchor="mm")
    return picture


def stacked(*pictures: Image.Image) -> Image.Image:
    """One below the other."""
    whole = Image.new("RGB", (max(p.width for p in pictures), sum(p.height for p in pictures)), "white")
    top = 0
    for picture in pictures:
        whole.paste(picture, (0, top))
        top += picture.height
    return whole


@contextmanager
def opened(path: Path, width: int) -> Iterator[Page]:
    """A page in a Chromium without a screen, ready to be looked at."""
    with sync_playwright() as started:
        own = shutil.which("chromium") or shutil.which("google-chrome")
        browser = started.chromium.launch(executable_path=own, args=ARGUMENTS)
        page = browser.new_page(viewport={"width": width, "height": HEIGHT})
        page.goto(path.resolve().as_uri())
        yield page
        browser.close()


def write(picture: Image.Image, path: Path) -> None:
    """As a PNG with a palette, which is a quarter of the size, dithered so that colours have no bands."""
    palette = picture.quantize(kmeans=PASSES, dither=Image.Dither.NONE)
    colours = palette.getpalette() or []
    rows = [colours[k : k + 3] for k in range(0, len(colours), 3)]
    palette.putpalette([part for row in rows for part in ([255] * 3 if min(row) > PANEL else row)])
    picture.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG).save(path, optimize=True)
    sys.stdout.write(
        f"{path.name}: {picture.width} x {picture.height}, {path.stat().st_size / 1000:.0f} kB\n"
    )


def shown(page: Page) -> dict[str, Any]:
    """What the first screen says, in the order of the page, and the version that says it."""
    return {"version": __version__} | {
        name: page.locator(f"header .{name}").first.locator(each).all_text_contents()
        for name, each in (("overall", "xpath=."), ("answers", "dd"), ("strip", "li"))
    }


def main(report: Path, out: Path, cohort: Path | None = None) -> None:
    with opened(report, WIDTH) as page:
        page.wait_for_function("() => document.documentElement.dataset.ready !== undefined", timeout=60_000)
        (out / SHOWN).write_text(json.dumps(shown(page), indent=1) + "\n", encoding="utf-8")
        for name, draw in PICTURES.items():
            write(draw(page), out / f"report_{name}.png")
    if cohort is None:
        return
    with opened(cohort, WIDTH - 2 * ROOM) as page:
        write(part(page, "h1", ".charts"), out / "report_cohort.png")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:4]))
