"""Size and start of a page: python -m benchmarks.page_start [RUN|PAGE] [--repeat 5]

RUN is a finished run; without one the demo is made afresh. Its page reports itself when it is ready, in ms
since it was asked for. PAGE is another page, such as the cohort.html of a thousand cases: it is ready when
its scripts have run and it is laid out and drawn. On a machine that does other work that is an upper bound,
and the least of some visits comes nearest. WebGL is drawn by software, as on a machine without a graphics
card.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from o3dls.report.writer import write_report
from tests.browser import Visit, chromium

LIMITS = {"size, MB": 4.0, "ready, ms": 2000.0}  # what is asked for, on two quiet cores
OTHER = 3.0  # MB, of a page of a thousand cases
READY = "Number(document.documentElement.dataset.ready)"
DRAWN = """() => new Promise((done) => requestAnimationFrame(
    () => requestAnimationFrame(() => done(performance.now()))))"""
CALLS = "Math.max(...JSON.parse(document.documentElement.dataset.drawCalls))"


def visited(browser: Any, page: Path, *, report: bool) -> dict[str, float]:
    """What one visit of a page took."""
    visit = Visit(browser, page, wait=report)
    found = {"ready, ms": visit.page.evaluate(READY if report else DRAWN)}
    if report:
        found["draw calls of a picture"] = visit.page.evaluate(CALLS)
    visit.page.close()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", nargs="?", type=Path, help="finished run, or a page; default: the demo")
    parser.add_argument("--repeat", type=int, default=5, help="visits, each in a new tab")
    asked = parser.parse_args()
    with TemporaryDirectory() as folder, chromium() as launch:
        run = asked.run or Path(folder) / "demo"
        if asked.run is None:
            subprocess.run([sys.executable, "-m", "o3dls", "demo", "--out", run], check=True)
        report = not run.is_file()
        page = write_report([run], Path(folder) / "page.html") if report else run
        browser = launch()
        visits = [visited(browser, page, report=report) for _ in range(asked.repeat)]
        most = LIMITS["size, MB"] if report else OTHER
        print(f"{'size, MB':24}{page.stat().st_size / 1e6:10.2f}   limit {most:g}")
        for key in visits[0]:
            values = [one[key] for one in visits]
            limit = f"   limit {LIMITS[key]:g}" if key in LIMITS else ""
            print(f"{key:24}{min(values):10.0f} at least, {median(values):.0f} in the middle{limit}")


if __name__ == "__main__":
    main()
