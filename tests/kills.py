"""`python -m tests.kills [--kills 40]` kills commands at random moments and counts what was torn by it.

The commands take turns, each over what it made before. Nothing that they made may be torn or gone, and the
next one, which is let be, removes what the dead one left.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path.insert(1, str(Path(__file__).resolve().parent))  # for what tests share, as pytest finds it

from tiny import ball_case

from o3dls.errors import O3dlsError
from o3dls.io.case_writer import write_case
from o3dls.io.manifest import missing
from o3dls.io.points import read_points
from o3dls.io.surfaces import read_surface
from o3dls.runs.folder import read_run
from tests.finished import finished
from tests.io.test_io_study import carto_folder

SEED = 70_937
FROM = 0.3  # of the time that a command takes: before it only imports are killed
PIPELINE = 'folds = 0\n[[stage]]\nuse = "landmarks"\n[[write]]\nuse = "report"\n'
FAULTS = (O3dlsError, OSError, AssertionError, ValueError, KeyError)


@dataclass
class Killed:
    """A command that is killed again and again: its arguments, and what raises where its work is torn."""

    name: str
    arguments: str
    whole: Callable[[Path], object]
    seconds: float = 0.0
    torn: list[str] = field(default_factory=list)

    def begin(self, folder: Path) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "o3dls", *self.arguments.split()]
        return subprocess.Popen(
            command, cwd=folder, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )

    def let_be(self, folder: Path) -> None:
        """Give the command and wait for it: it works whatever lies there, and leaves nothing half made."""
        begun = time.perf_counter()
        said = (done := self.begin(folder)).communicate()[1].decode()
        self.seconds = time.perf_counter() - begun
        self.look(folder, done.returncode != 0 and f"exit {done.returncode}: {said}")
        half = [path.name for path in folder.rglob("*") if ".partial-" in path.name]
        self.look(folder, half and f"left {', '.join(half)}")

    def kill(self, folder: Path, moment: float) -> bool:
        """Kill the command and all that it began at a share of its time; say whether it was still at work."""
        process = self.begin(folder)
        time.sleep(moment * self.seconds)
        at_work = process.poll() is None
        os.killpg(process.pid, signal.SIGKILL) if at_work else None
        process.communicate()
        self.look(folder)
        return at_work

    def look(self, folder: Path, fault: object = "") -> None:
        """Note what is torn or gone."""
        try:
            self.whole(folder)
        except FAULTS as error:
            fault = fault or f"{type(error).__name__}: {error}"
        if fault:
            self.torn.append(str(fault))


def _run_is_whole(name: str) -> Callable[[Path], object]:
    def whole(folder: Path) -> None:
        assert missing(folder / name) == []
        read_run(folder / name)
        _page_is_whole(folder / name / "report.html")

    return whole


def _page_is_whole(page: Path) -> None:
    assert page.read_text(encoding="utf-8").endswith("</html>\n"), page


def _batch_is_whole(folder: Path) -> None:
    for name in ("one", "two"):
        if (folder / "runs" / name).exists():  # those that are there stay, and others may be missing
            assert missing(folder / "runs" / name) == []
            read_run(folder / "runs" / name)
    if (table := folder / "runs/cohort.csv").exists():
        assert table.read_text().endswith("\n")
    if (page := folder / "runs/cohort.html").exists():
        _page_is_whole(page)


def commands(folder: Path) -> list[Killed]:
    """Make what the commands need, and let each make what it is to replace."""
    for name in ("one", "two"):
        write_case(folder / name, replace(ball_case(), name=name))
    (folder / "p.toml").write_text(PIPELINE)
    finished(folder / "done")
    carto_folder(folder / "study")
    faces = len(ball_case().prior.faces)

    def exported(at: Path) -> None:
        assert len(read_surface(at / "a.ply").faces) == faces
        assert (at / "a.ply.json").read_text().rstrip().endswith("}")

    def converted(at: Path) -> None:
        assert len(read_surface(at / "b.stl").faces) == faces

    def imported(at: Path) -> None:
        assert missing(at / "case") == []
        read_points(at / "case/points.csv")

    found = [
        Killed("run", "run p.toml --case one --out run --force", _run_is_whole("run")),
        Killed("batch", "batch one two --pipeline p.toml --out runs --force", _batch_is_whole),
        Killed("export", "export done --format ply --out a.ply", exported),
        Killed("convert", "convert one/prior.ply b.stl", converted),
        Killed("import", "import study case --map 1-Map --force", imported),
        Killed("report", "report done", lambda at: _page_is_whole(at / "done/report.html")),
    ]
    for one in found:
        one.let_be(folder)  # compiles, too
        one.let_be(folder)
    return found


def kills(count: int, folder: Path, seed: int = SEED) -> Iterator[tuple[Killed, bool]]:
    """Kill so many commands in turns, and let each be afterwards; yield each with whether it was still at
    work. Those that were not come on top.
    """
    every, rng = commands(folder), np.random.default_rng(seed)
    killed = tried = 0
    while killed < count and tried < 3 * count:
        one = every[tried % len(every)]
        at_work = one.kill(folder, float(rng.uniform(FROM, 1.0)))
        one.let_be(folder)
        killed, tried = killed + at_work, tried + 1
        yield one, at_work


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=40)
    parser.add_argument("--seed", type=int, default=SEED)
    given = parser.parse_args()
    with TemporaryDirectory() as folder:
        done = list(kills(given.kills, Path(folder), given.seed))
    names = {one.name: one for one, _ in done}
    for name, one in names.items():
        own = [at_work for other, at_work in done if other is one]
        print(f"{name:8s} {sum(own)} killed, {len(own) - sum(own)} had ended, {len(one.torn)} torn")
        print(*(f"         {fault}" for fault in one.torn), sep="\n", end="\n" if one.torn else "")
    print(f"{sum(at_work for _, at_work in done)} kills, {sum(len(one.torn) for one in names.values())} torn")
    sys.exit(any(one.torn for one in names.values()))


if __name__ == "__main__":
    main()
