"""Draw the pictures of docs/tutorial_app.md: what its steps show on the page of `o3dls app`.

    python tools/app_pictures.py docs

Needs playwright (the extra `test`) and a Chromium.
"""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.app.hand import RUN, Hand, ready
from tests.app.served import served
from tests.browser import Visit, chromium
from tools.report_pictures import write

WIDTH, HEIGHT = 1300, 860  # of the window
STUDY = [sys.executable, "-m", "data_synth", "study", "study", "--carto", "--seed", "7"]
Take = Callable[[str, str], None]  # of a name and the element that is to be seen


def walk(hand: Hand, study: Path, take: Take) -> None:
    """Do what docs/tutorial_app.md says, with the files of `study`; `take` is called at each picture."""
    page = hand.page
    hand.drop("prior", study / "la_labels.nii.gz")
    hand.sees("#prior .read", "ml")
    page.set_input_files("#map-folder", study / "export")
    hand.sees("#map .read", "CARTO 3, map 1-LA")
    hand.drop("image", study / "lge.nii.gz")
    hand.sees("#image .read", "Spacing")
    hand.type("#name", "first")
    take("bring", "#bring")
    hand.click("#make")
    hand.sees("#placing", "Nothing says yet where the prior stands")
    ready(hand.visit)
    hand.press("Find the pose")
    hand.sees("#sure", "The pose was found with confidence 1.00.")
    take("place", "main")
    hand.click("#place")
    hand.sees("#placing", "init matrix")
    hand.click("[name=preset][value=quick]")
    hand.click("#fuse")
    hand.sees("#log", "icp:", RUN)
    take("fuse", "#fusing")
    hand.sees("#fused", "The run is done.", RUN)
    hand.click("text=Judge it")
    hand.sees("#judge", "level_set of case")
    hand.press("Export vtp")
    hand.sees("#take", "runs/first-quick/export/level_set.vtp")
    take("judge", "main")


def make_study(folder: Path) -> Path:
    """Make the files of the tutorial, as its first command does."""
    subprocess.run(STUDY, cwd=folder, check=True, capture_output=True)
    return folder / "study"


def main(out: Path) -> None:
    with TemporaryDirectory() as name, served(Path(name) / "work") as app, chromium() as launch:
        visit = Visit(launch(), app.server.url, width=WIDTH, height=HEIGHT, wait=False)

        def take(picture: str, element: str) -> None:
            visit.page.wait_for_timeout(1000)
            shown = visit.page.locator(element).screenshot()
            write(Image.open(io.BytesIO(shown)).convert("RGB"), out / f"tutorial_app_{picture}.png")

        walk(Hand(visit), make_study(Path(name)), take)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
