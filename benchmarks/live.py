"""A live session under load: python -m benchmarks.live [--faces 30000] [--points 300] [--rates 2 10]
[--many 5000] [--page | --script]

Points of the true wall of the built-in atrium, 1 mm beside it, come at an even rate. Printed is for each rate
how many were lost or out of order, with how many the first surface came, and from then on the time from a
point to the event `surface` that knows it (median, 95th percentile and most, in ms; without what a page takes
to draw it); then median and most of those points alone that waited while a full fit ran or was taken over,
and the most of the others; then the memory of the engine while many more points come as fast as it takes
them.

With --page it is the time from a point to the picture: the session has --before points; then more come at
each rate, and a page of Chromium without a screen, on the same cores, says when the surface that knows each
was drawn: in the frame after the surface's buffers were written. With --script there is no engine: the events
of some updates are published again and again, and the times are those of server and page alone. WebGL is
drawn by software, as on a machine without a graphics card. On a machine that does other work the times are
upper bounds.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from math import inf, isfinite
from pathlib import Path
from threading import Condition
from time import monotonic, sleep, time
from typing import TYPE_CHECKING, Any

from benchmarks.speed import refined

if TYPE_CHECKING:
    from o3dls.case import Case
    from o3dls.live.host import Host
    from o3dls.live.server import LiveServer

SEED = 517_203
NOISE = 1.0  # mm, sd per axis
PATIENCE = 120.0  # seconds for what was sent last
TOGETHER = 25  # points that are sent before their surface is waited for, where many come
PAGE_LIMITS = {  # of the script or a session: ms, by percentile
    True: {50: 30.0, 95: 60.0},
    False: {50: 100.0, 95: 200.0},
}
WATCH = """() => {
    window.drawnAt = {};
    new MutationObserver(() => {
        window.drawnAt[document.documentElement.dataset.drawn] = performance.timeOrigin + performance.now();
    }).observe(document.documentElement, { attributeFilter: ['data-drawn'] });
}"""
Message = dict[str, Any]


@dataclass
class Heard:
    """What a session told: when the surface knew each point, and the order of the points."""

    known: dict[int, float] = field(default_factory=dict)
    points: list[int] = field(default_factory=list)
    newest: int = 0
    first: int = 0  # point of the first surface
    fitted: int = 0
    fits: list[list[float]] = field(default_factory=list)  # when full fits began and ended
    changed: Condition = field(default_factory=Condition)
    others: list[Callable[[Message], None]] = field(default_factory=list)  # who hear it too

    def __call__(self, message: Message) -> None:
        for other in self.others:
            other(message)
        with self.changed:
            if message["event"] == "point":
                self.points.append(message["id"])
            elif message["event"] == "surface":
                now = monotonic()
                for number in range(self.newest + 1, message["after"] + 1):
                    self.known[number] = now
                self.newest = message["after"]
                self.first = self.first or self.newest
            elif message["event"] == "state":
                self.fitted = message["fitted"]
                self._note_full_fit(message["fit"] != "idle", monotonic())
            self.changed.notify_all()

    def _note_full_fit(self, runs: bool, now: float) -> None:
        if runs and (not self.fits or isfinite(self.fits[-1][1])):
            self.fits.append([now, inf])
        elif not runs and self.fits and not isfinite(self.fits[-1][1]):
            self.fits[-1][1] = now

    def beside_a_fit(self, sent: float, known: float) -> bool:
        """Whether a full fit ran, or was taken over, while a point waited."""
        return any(sent < end and begin < known for begin, end in self.fits)

    def wait(self, number: int) -> bool:
        """Whether the surface comes to know a point."""
        with self.changed:
            return self.changed.wait_for(lambda: self.newest >= number, PATIENCE)


@contextmanager
def session(case: Case, folder: Path) -> Iterator[tuple[Host, Heard]]:
    """A session of a case that knows its landmarks and no points."""
    from o3dls.io.case_writer import write_case
    from o3dls.io.points import write_points
    from o3dls.live.host import Host
    from o3dls.live.record import open_record

    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of the engine's process, as on the command line
    write_case(folder / "case", case)
    write_points(folder / "case" / "points.csv", case.points.of("landmark"))
    heard = Heard()
    host = Host(*open_record(folder / "record", folder / "case"), heard)
    host.begin()
    try:
        yield host, heard
    finally:
        host.close()


def mapped(faces: int, points: int) -> tuple[Case, list[Message]]:
    """The built-in atrium with a prior of about so many faces, and points beside its true wall."""
    import numpy as np

    from o3dls.evaluation.distances import sample
    from o3dls.io.case_reader import read_case
    from o3dls.resources import demo_case

    case = read_case(demo_case())
    assert case.truth is not None
    assert case.truth.surface is not None
    rng = np.random.default_rng(SEED)
    at = sample(case.truth.surface, points, SEED) + NOISE * rng.standard_normal((points, 3))
    return replace(case, prior=refined(case.prior, faces), truth=None), [
        {"do": "take", "xyz": one} for one in rng.permutation(at).tolist()
    ]


def at_rate(case: Case, takes: list[Message], rate: float) -> str:
    """A row of the table: points at an even rate, and how long each waited for its surface."""
    import numpy as np

    with tempfile.TemporaryDirectory() as folder, session(case, Path(folder)) as (host, heard):
        sent = {}
        sleep(10.0)  # processes begin
        begin = monotonic()
        for k, one in enumerate(takes):
            sleep(max(0.0, begin + k / rate - monotonic()))
            sent[k + 1] = monotonic()
            host.act(one)
        last = heard.wait(len(takes))
    lost = len(takes) - len(heard.points) + (not last)
    turned = sum(b <= a for a, b in zip(heard.points, heard.points[1:], strict=False))
    later = [k for k in sent if k > heard.first and k in heard.known]
    waits = 1e3 * np.array([heard.known[k] - sent[k] for k in later])
    beside = np.array([heard.beside_a_fit(sent[k], heard.known[k]) for k in later])
    p50, p95 = np.percentile(waits, [50, 95])
    apart = [np.median(waits[beside]) if beside.any() else 0.0]
    apart += [np.max(waits[beside], initial=0.0), np.max(waits[~beside], initial=0.0)]
    found = [round(one) for one in (p50, p95, waits.max(), *apart)]
    row = [rate, len(takes), lost, turned, heard.first, *found, int(beside.sum())]
    return f"| {' | '.join(map(str, row))} |"


def memory(case: Case, takes: list[Message]) -> Iterator[str]:
    """Rows of the table of the engine's memory while many points come."""
    from multiprocessing import active_children

    from o3dls.pipeline.supervision import MB, resident

    with tempfile.TemporaryDirectory() as folder, session(case, Path(folder)) as (host, heard):
        for k, one in enumerate(takes, 1):
            host.act(one)
            if k % TOGETHER == 0 and k > TOGETHER:
                heard.wait(k)
            if k % (len(takes) // 10) == 0:
                engine = max(resident(child.pid or 0) for child in active_children())
                yield f"| {k} | {heard.newest} | {engine / MB:.0f} | {resident(os.getpid()) / MB:.0f} |"


def publish_script(
    page: Any, server: LiveServer, surfaces: list[Any], events: int, rate: float
) -> list[float]:
    """Milliseconds of each event that was drawn; newer ones may have taken the place of others."""
    page.evaluate(WATCH)
    sent = []
    for k in range(events):
        sent.append(time() * 1000)
        server.publish({**surfaces[k % len(surfaces)], "after": k, "mark": k})
        page.wait_for_timeout(1000 / rate)
    drawn = page.evaluate("window.drawnAt")
    first = server.board.last("surface")["seq"] - events + 1
    return [drawn[str(first + k)] - sent[k] for k in range(events) if str(first + k) in drawn]


def draw_session(
    launch: Any, points: int, rate: float, before: int, faces: int
) -> tuple[list[float], list[float], list[float]]:
    """Milliseconds from taking each point to the first picture that knows it, of these the ones that waited
    while a full fit ran or was taken over, and those to the engine's event.
    """
    from o3dls.live.server import LiveServer

    case, takes = mapped(faces, before + points)
    numbers: dict[int, int] = {}  # by the event's, the newest point that it knows

    def note(message: dict[str, Any]) -> None:
        if message["event"] == "surface":
            numbers[server.board.last("surface")["seq"]] = message["after"]

    with tempfile.TemporaryDirectory() as folder, session(case, Path(folder)) as (host, heard):
        server = LiveServer(host.act)
        heard.others += [server.publish, note]
        page = open_page(launch, server)
        for one in takes[:before]:
            host.act(one)
        heard.wait(before)
        while heard.fitted < before:
            page.wait_for_timeout(100)
        page.wait_for_timeout(10_000)  # the full fit that many points at once ask for
        page.evaluate(WATCH)
        sent, begin, wall = [], time(), time() - monotonic()
        for k, one in enumerate(takes[before:]):
            sleep(max(0.0, begin + k / rate - time()))
            sent.append(time() * 1000)
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


def open_page(launch: Any, server: LiveServer) -> Any:
    """The server's page, ready."""
    page = launch().new_page(viewport={"width": 1440, "height": 900})
    page.goto(server.url)
    page.wait_for_function("() => document.documentElement.dataset.ready !== undefined", timeout=60_000)
    page.wait_for_timeout(1000)
    return page


def draw_script(launch: Any, points: int, rate: float) -> list[float]:
    """Milliseconds from publishing each event to its picture, without an engine."""
    from o3dls.live.server import LiveServer
    from tests.live.scripted import script, state

    played = script(more=10)
    server = LiveServer(lambda action: {"ok": True})
    for event in (played.scene, *played.points, state()):
        server.publish(event)
    found = publish_script(open_page(launch, server), server, played.surfaces, points, rate)
    server.close()
    return found


def page_table(asked: argparse.Namespace) -> Iterator[str]:
    """Lines of how long the points of each rate waited for their picture."""
    import numpy as np

    from tests.browser import chromium

    for rate in asked.rates:
        beside: list[float] = []
        engine: list[float] = []
        with chromium() as launch:
            if asked.script:
                found = draw_script(launch, asked.points, rate)
            else:
                found, beside, engine = draw_session(launch, asked.points, rate, asked.before, asked.faces)
        yield f"{len(found)} of {asked.points} points drawn, {rate:g} a second"
        for percentile, limit in PAGE_LIMITS[asked.script].items():
            yield f"p{percentile}, ms {np.percentile(found, percentile):10.0f}   limit {limit:g}"
        yield f"the longest {', '.join(f'{one:.0f}' for one in sorted(found)[-3:])}"
        if beside:
            most = ", ".join(f"{one:.0f}" for one in sorted(beside)[-3:])
            p50 = np.median(beside)
            yield f"of these {len(beside)} while a full fit ran: p50 {p50:.0f}, the longest {most}"
            yield f"the longest of the others {max(set(found) - set(beside), default=0.0):.0f}"
        if engine:
            p50, p95 = np.percentile(engine, [50, 95])
            yield f"of these to the engine's event: p50 {p50:.0f}, p95 {p95:.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--faces", type=int, default=30_000)
    parser.add_argument("--points", type=int, default=300)
    parser.add_argument("--rates", type=float, nargs="*", default=[2.0, 10.0])
    parser.add_argument("--many", type=int, default=5000)
    parser.add_argument("--page", action="store_true", help="to the picture of a page")
    parser.add_argument("--before", type=int, default=250, help="with --page: points that are there already")
    parser.add_argument("--script", action="store_true", help="server and page alone, without an engine")
    given = parser.parse_args()
    if given.page or given.script:
        for line in page_table(given):
            print(line, flush=True)
        return
    case, takes = mapped(given.faces, given.points)
    print(f"prior of {len(case.prior.faces)} faces\n")
    print(
        "| points a second | points | lost | out of order | first | median | 95 % | most "
        "| median beside a full fit | most beside one | most of the others | points beside one |\n"
        f"|{'---|' * 12}"
    )
    for rate in given.rates:
        print(at_rate(case, takes, rate), flush=True)
    if given.many:
        print("\n| points | in the surface | engine MB | command MB |\n|---|---|---|---|")
        for row in memory(*mapped(given.faces, given.many)):
            print(row, flush=True)


if __name__ == "__main__":
    main()
