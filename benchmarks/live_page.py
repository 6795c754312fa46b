"""From an event to the picture: python -m benchmarks.live_page [--events 200] [--rate 10]

The demo case is fitted and updated point by point; the events of these updates are published again and again,
and a page of Chromium without a screen says when each was drawn: in the frame after the surface's buffers
were written. WebGL is drawn by software, as on a machine without a graphics card. On a machine that does
other work the times are upper bounds.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

from o3dls.live.server import LiveServer
from tests.browser import chromium
from tests.live.scripted import script, state

LIMITS = {50: 30.0, 95: 60.0}  # ms, percentiles
WATCH = """() => {
    window.drawnAt = {};
    new MutationObserver(() => {
        window.drawnAt[document.documentElement.dataset.drawn] = performance.timeOrigin + performance.now();
    }).observe(document.documentElement, { attributeFilter: ['data-drawn'] });
}"""


def measured(page: Any, server: LiveServer, surfaces: list[Any], events: int, rate: float) -> list[float]:
    """Milliseconds of each event that was drawn; newer ones may have taken the place of others."""
    page.evaluate(WATCH)
    sent = []
    for k in range(events):
        sent.append(time.time() * 1000)
        server.publish({**surfaces[k % len(surfaces)], "after": k, "mark": k})
        page.wait_for_timeout(1000 / rate)
    drawn = page.evaluate("window.drawnAt")
    first = server.board.last("surface")["seq"] - events + 1
    return [drawn[str(first + k)] - sent[k] for k in range(events) if str(first + k) in drawn]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--events", type=int, default=200)
    parser.add_argument("--rate", type=float, default=10.0, help="events a second")
    asked = parser.parse_args()
    played = script(more=10)
    server = LiveServer(lambda action: {"ok": True})
    for event in (played.scene, *played.points, state()):
        server.publish(event)
    with chromium() as launch:
        page = launch().new_page(viewport={"width": 1440, "height": 900})
        page.goto(server.url)
        page.wait_for_function("() => document.documentElement.dataset.ready !== undefined", timeout=60_000)
        page.wait_for_timeout(1000)
        found = measured(page, server, played.surfaces, asked.events, asked.rate)
    server.close()
    print(f"{len(found)} of {asked.events} surfaces drawn, {asked.rate:g} a second")
    for percentile, limit in LIMITS.items():
        print(f"p{percentile}, ms {np.percentile(found, percentile):10.0f}   limit {limit:g}")


if __name__ == "__main__":
    main()
