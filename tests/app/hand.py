"""A hand with a mouse: it does what a person does on the page, and counts it."""

from __future__ import annotations

import base64
import re
from pathlib import Path
from typing import Any

import numpy as np

from o3dls.arrays import Array
from tests.browser import Visit

READ = 60_000  # ms
RUN = 500_000  # ms, of a whole run on cores that others use too
DROP = """([role, name, text]) => {
    const data = new DataTransfer();
    data.items.add(new File([Uint8Array.from(atob(text), one => one.charCodeAt(0))], name));
    const slot = document.getElementById(role);
    const how = { dataTransfer: data, bubbles: true, cancelable: true };
    document.addEventListener("load", ({ target }) => {
        if (target.tagName === "IMG") window.pictured ??= performance.now();
    }, true);
    [window.pictured, window.dropped] = [undefined, performance.now()];
    for (const kind of ["dragover", "drop"]) slot.dispatchEvent(new DragEvent(kind, how));
}"""


class Hand:
    """Each method is one action: a drop, a click, a choice, or a name that is typed."""

    def __init__(self, visit: Visit) -> None:
        self.visit, self.actions = visit, 0
        self.heard: list[str] = []

    @property
    def page(self) -> Any:
        return self.visit.page

    def drop(self, role: str, path: Path) -> None:
        """Drop a file on the box of its role."""
        self.actions += 1
        content = base64.b64encode(path.read_bytes()).decode()
        self.page.evaluate(DROP, [role, path.name, content])

    def seconds_to_picture(self) -> float:
        """By the clock of the browser, from the drop to the first picture of what was dropped."""
        self.page.wait_for_function("() => window.pictured !== undefined", timeout=READ)
        return float(self.page.evaluate("(window.pictured - window.dropped) / 1000"))

    def click(self, selector: str) -> None:
        self.actions += 1
        self.page.click(selector, timeout=READ)

    def press(self, name: str) -> None:
        """Click the button of a name."""
        self.actions += 1
        self.page.get_by_role("button", name=name, exact=True).click(timeout=READ)

    def type(self, selector: str, text: str) -> None:
        self.actions += 1
        self.page.fill(selector, text)

    def point(self, pixel: Array) -> None:
        """Click a place (2,) of the picture."""
        self.actions += 1
        self.page.mouse.click(*pixel.tolist())

    def load(self, selector: str) -> Path:
        """Click a link to a file, and return the file that comes."""
        self.actions += 1
        with self.page.expect_download() as loaded:
            self.page.click(selector)
        return Path(loaded.value.path())

    def sees(self, selector: str, text: str, patience: int = READ) -> None:
        """Wait until an element says a text; this is no action."""
        says(self.visit, selector, text, patience)
        self.heard.append(text)


def says(visit: Visit, selector: str, text: str, patience: int = READ) -> None:
    """Wait until an element says a text."""
    visit.page.locator(selector, has_text=re.compile(re.escape(text))).first.wait_for(timeout=patience)


def ready(visit: Visit) -> None:
    """Wait until the picture in 3D is there."""
    visit.page.wait_for_function("() => document.documentElement.dataset.ready !== undefined", timeout=READ)


def pixels_of(visit: Visit, shown: Array, places: Array) -> Array:
    """Where on the screen places (n, 3) are seen, in the first view, which frames `shown` (m, 3)."""
    found = visit.page.evaluate(
        """() => {
            const canvas = document.querySelector("#panels canvas");
            canvas.scrollIntoView({ block: "center" });
            const { left, top, width, height } = canvas.getBoundingClientRect();
            const { tall, looksFrom } = document.getElementById("panels").dataset;
            const { up } = JSON.parse(document.getElementById("scene").textContent);
            return { box: [left, top, width, height], tall: Number(tall), from: JSON.parse(looksFrom), up };
        }"""
    )
    left, top, width, height = found["box"]
    towards = np.array(found["from"])
    right = np.cross(found["up"], towards)
    right = right / np.linalg.norm(right)
    axes = np.stack([right, -np.cross(towards, right)], axis=1)
    middle = ((shown @ axes).min(axis=0) + (shown @ axes).max(axis=0)) / 2
    scale = height / found["tall"]
    return (places @ axes - middle) * scale + np.array([left + width / 2, top + height / 2])
