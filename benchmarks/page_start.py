"""Size and start of a report's page: python -m benchmarks.page_start [RUN] [--repeat 5]

RUN is a finished run; without one the demo is made afresh. A page reports itself when it is ready, in ms
since it was asked for. On a machine that does other work that is an upper bound, and the least of some
visits comes nearest. WebGL is drawn by software, as on a machine without a graphics card.
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
READY = "Number(document.documentElement.dataset.ready)"
CALLS = "Math.max(...JSON.parse(document.documentElement.dataset.drawCalls))"


def visited(browser: Any, page: Path) -> dict[str, float]:
    """What one visit of a page took."""
    visit = Visit(browser, page)
    found = {"ready, ms": visit.page.evaluate(READY), "draw calls of a picture": visit.page.evaluate(CALLS)}
    visit.page.close()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", nargs="?", type=Path, help="finished run; default: the demo")
    parser.add_argument("--repeat", type=int, default=5, help="visits, each in a new tab")
    asked = parser.parse_args()
    with TemporaryDirectory() as folder, chromium() as launch:
        run = asked.run or Path(folder) / "demo"
        if asked.run is None:
            subprocess.run([sys.executable, "-m", "o3dls", "demo", "--out", run], check=True)
        page = write_report([run], Path(folder) / "page.html")
        browser = launch()
        visits = [visited(browser, page) for _ in range(asked.repeat)]
        print(f"{'size, MB':24}{page.stat().st_size / 1e6:10.2f}   limit {LIMITS['size, MB']:g}")
        for key in visits[0]:
            values = [one[key] for one in visits]
            limit = f"   limit {LIMITS[key]:g}" if key in LIMITS else ""
            print(f"{key:24}{min(values):10.0f} at least, {median(values):.0f} in the middle{limit}")


if __name__ == "__main__":
    main()
