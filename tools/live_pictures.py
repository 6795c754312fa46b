"""Draw the pictures of docs/tutorial_live.md: the page of a session after some, more, and all points.

    python tools/live_pictures.py docs

Needs playwright (the extra `test`) and a Chromium.
"""

from __future__ import annotations

import io
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.browser import chromium
from tools.report_pictures import write

WIDTH, HEIGHT = 1400, 900  # of the window
MOMENTS = {"live_first": 15, "live_middle": 50, "live_last": 100}  # points taken
SETTLED = """([count, all]) => {
    const now = document.getElementById('points-now').textContent.match(/\\d+/g);
    return now && +now[0] >= count && (!all || +now[1] >= count);
}"""
PATIENT = """
set -eu
python -m data_synth atrium patient --seed 7 --points 100
grep -v landmark patient/points.csv > map.csv
grep -E '^x,|landmark' patient/points.csv > landmarks.csv
mv landmarks.csv patient/points.csv
rm patient/outliers.csv
"""


def taken(page: Any, out: Path) -> None:
    """A picture of the window."""
    write(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), out)


def main(out: Path) -> None:
    with TemporaryDirectory() as name:
        subprocess.run(["sh", "-c", PATIENT], cwd=name, check=True)
        command = [sys.executable, "-m", "o3dls", "live", "patient", "--replay", "map.csv", "--rate", "1"]
        with (
            subprocess.Popen(
                [*command, "--no-browser", "--record", "session"], cwd=name, stderr=subprocess.PIPE, text=True
            ) as session,
            chromium() as launch,
        ):
            assert session.stderr is not None
            page = launch().new_page(viewport={"width": WIDTH, "height": HEIGHT})
            page.goto(session.stderr.readline().strip())
            for picture, count in MOMENTS.items():
                page.wait_for_function(SETTLED, arg=[count, count == 100], timeout=300_000)
                page.wait_for_timeout(1500)
                taken(page, out / f"{picture}.png")
            session.terminate()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
