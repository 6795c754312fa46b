"""From a point to the picture: python -m benchmarks.live_page [--points 300] [--rate 2] [--script]

A session of the built-in atrium, its prior refined to --faces, has --before points; then more come at an even
rate, and a page of Chromium without a screen, on the same cores, says when the surface that knows each was
drawn: in the frame after the surface's buffers were written. With --script there is no engine: the events of
some updates are published again and again, and the times are those of server and page alone.
WebGL is drawn by software, as on a machine without a graphics card. On a machine that does other work the
times are upper bounds.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.live import mapped, session
from o3dls.live.server import LiveServer
from tests.browser import chromium
from tests.live.scripted import script, state

LIMITS = {
    True: {50: 30.0, 95: 60.0},
    False: {50: 100.0, 95: 200.0},
}  # of the script or a session: ms, percentiles
WATCH = """() => {
    window.drawnAt = {};
    new MutationObserver(() => {
        window.drawnAt[document.documentElement.dataset.drawn] = performance.timeOrigin + performance.now();
    }).observe(document.documentElement, { attributeFilter: ['data-drawn'] });
}"""


def scripted(page: Any, server: LiveServer, surfaces: list[Any], events: int, rate: float) -> list[float]:
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


def in_session(
    launch: Any, points: int, rate: float, before: int, faces: int
) -> tuple[list[float], list[float], list[float]]:
    """Milliseconds from taking each point to the first picture that knows it, of these the ones that waited
    while a full fit ran or was taken over, and those to the engine's event.
    """
    case, takes = mapped(faces, before + points)
    numbers = {}  # by the event's, the newest point that it knows

    def note(message: dict[str, Any]) -> None:
        if message["event"] == "surface":
            numbers[server.board.last("surface")["seq"]] = message["after"]

    with TemporaryDirectory() as folder, session(case, Path(folder)) as (host, heard):
        server = LiveServer(host.act)
        heard.others += [server.publish, note]
        page = opened(launch, server)
        for one in takes[:before]:
            host.act(one)
        heard.wait(before)
        while heard.fitted < before:
            page.wait_for_timeout(100)
        page.wait_for_timeout(10_000)  # the full fit that many points at once ask for
        page.evaluate(WATCH)
        sent, begin, wall = [], time.time(), time.time() - time.monotonic()
        for k, one in enumerate(takes[before:]):
            time.sleep(max(0.0, begin + k / rate - time.time()))
            sent.append(time.time() * 1000)
            host.act(one)
        heard.wait(len(takes))
        page.wait_for_timeout(2000)
        drawn = {int(seq): at for seq, at in page.evaluate("window.drawnAt").items() if int(seq) in numbers}
        server.close()
    engine = [1000 * (heard.known[before + k] + wall) - at for k, at in enumerate(sent, 1)]
    waits, beside = [], []
    for k, at in enumerate(sent, before + 1):
        known = min((when for seq, when in drawn.items() if numbers[seq] >= k), default=None)
        if known is not None:
            waits += [known - at]
            beside += waits[-1:] if heard.beside_a_fit(at / 1000 - wall, known / 1000 - wall) else []
    return waits, beside, engine


def opened(launch: Any, server: LiveServer) -> Any:
    """The server's page, ready."""
    page = launch().new_page(viewport={"width": 1440, "height": 900})
    page.goto(server.url)
    page.wait_for_function("() => document.documentElement.dataset.ready !== undefined", timeout=60_000)
    page.wait_for_timeout(1000)
    return page


def from_script(launch: Any, points: int, rate: float) -> list[float]:
    """The same from publishing each event, without an engine."""
    played = script(more=10)
    server = LiveServer(lambda action: {"ok": True})
    for event in (played.scene, *played.points, state()):
        server.publish(event)
    found = scripted(opened(launch, server), server, played.surfaces, points, rate)
    server.close()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=300)
    parser.add_argument("--rate", type=float, default=2.0, help="points a second")
    parser.add_argument("--before", type=int, default=250, help="points that are there already")
    parser.add_argument("--faces", type=int, default=30_000)
    parser.add_argument("--script", action="store_true", help="server and page alone, without an engine")
    asked = parser.parse_args()
    with chromium() as launch:
        if asked.script:
            found, beside, engine = from_script(launch, asked.points, asked.rate), [], []
        else:
            found, beside, engine = in_session(launch, asked.points, asked.rate, asked.before, asked.faces)
    print(f"{len(found)} of {asked.points} points drawn, {asked.rate:g} a second")
    for percentile, limit in LIMITS[asked.script].items():
        print(f"p{percentile}, ms {np.percentile(found, percentile):10.0f}   limit {limit:g}")
    print(f"the longest {', '.join(f'{one:.0f}' for one in sorted(found)[-3:])}")
    if beside:
        most = ", ".join(f"{one:.0f}" for one in sorted(beside)[-3:])
        print(f"of these {len(beside)} while a full fit ran: p50 {np.median(beside):.0f}, the longest {most}")
        print(f"the longest of the others {max(set(found) - set(beside), default=0.0):.0f}")
    if engine:
        p50, p95 = np.percentile(engine, [50, 95])
        print(f"of these to the engine's event: p50 {p50:.0f}, p95 {p95:.0f}")


if __name__ == "__main__":
    main()
