"""The n-th operation of the system fails, for every n until a command passes untouched: what it writes is old
or new and never torn, it says why in one line, and its exit code is that of the document.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from tiny import ball_case

from o3dls.case import Case
from o3dls.cli.main import answer
from o3dls.errors import InputError
from o3dls.io.case_reader import read_case
from o3dls.io.case_writer import write_case
from o3dls.io.manifest import missing
from o3dls.io.surfaces import read_surface, write_surface
from o3dls.live.journal import read_journal
from o3dls.live.record import open_record
from o3dls.runs.folder import read_run
from tests.app.served import served
from tests.failing import each_failure
from tests.finished import finished
from tests.io.test_io_study import carto_folder

OPERATIONS = ("open", "write", "fsync", "replace", "mkdir")
BESIDE = (".failed.log", ".crash.json", ".failed.json")  # what a failure may leave
PIPELINE = 'folds = 0\n[[stage]]\nuse = "landmarks"\n'


def state(folder: Path) -> dict[str, str]:
    """The files of a folder by their content; a folder that is empty is named too."""
    return {
        path.relative_to(folder).as_posix(): sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
        for path in sorted(folder.rglob("*"))
        if path.is_file() or not any(path.iterdir())
    }


class Trial:
    """A folder in which a command is given again and again, from the same state."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.folder, self.capsys = folder, capsys

    def __call__(
        self,
        kind: str,
        command: list[str],
        whole: Callable[[Path], object],
        *,
        step: int = 1,
        shim_folder: Path | None = None,
    ) -> int:
        """Give the command with each operation failing; gives the number of operations. whole: raises where
        what was made is torn.
        """
        before, failures = state(self.folder), 0
        for shim in each_failure(kind, shim_folder or self.folder, step=step):
            code = answer(command)
            shim.over = True
            said = self.capsys.readouterr().err
            left = {name: one for name, one in state(self.folder).items() if not name.endswith(BESIDE)}
            assert "Traceback" not in said, said
            assert "internal error" not in said, said
            assert not [name for name in left if ".partial-" in name], left
            if code in (0, 1):
                whole(self.folder)
            else:
                failures += 1
                assert code == 2, said
                assert len([line for line in said.splitlines() if line.startswith("o3dls: ")]) == 1, said
                if left != before:  # it failed while it told of what it had made
                    assert kind == "allocation", (shim.number, left.keys() ^ before.keys(), said)
                    whole(self.folder)
            self.restore(before)
        return failures

    def restore(self, before: dict[str, str]) -> None:
        """Remove what is new."""
        for name in state(self.folder).keys() - before.keys():
            path = self.folder / name
            path.unlink() if path.is_file() else path.rmdir()
        for path in sorted((p for p in self.folder.rglob("*") if p.is_dir()), reverse=True):
            if not any(path.iterdir()) and path.relative_to(self.folder).as_posix() not in before:
                path.rmdir()


@pytest.fixture
def trial(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Trial:
    return Trial(tmp_path, capsys)


def run_of_ball(folder: Path) -> list[str]:
    write_case(folder / "ball", ball_case())
    (folder / "p.toml").write_text(PIPELINE)
    return ["run", f"{folder}/p.toml", "--case", f"{folder}/ball", "--out", f"{folder}/run"]


def written(folder: Path, name: str = "run") -> None:
    assert missing(folder / name) == []
    read_run(folder / name)


@pytest.mark.parametrize("kind", OPERATIONS)
def test_run(kind: str, trial: Trial, tmp_path: Path) -> None:
    command = run_of_ball(tmp_path)
    answer(command)  # imports
    trial.restore({name: "" for name in state(tmp_path) if not name.startswith("run/")})
    trial.capsys.readouterr()
    assert trial(kind, command, written) > (3 if kind == "mkdir" else 10)


def test_run_where_memory_ends(trial: Trial, tmp_path: Path) -> None:
    assert trial("allocation", run_of_ball(tmp_path), written, step=7) > 3


@pytest.mark.parametrize("kind", OPERATIONS)
def test_report(kind: str, trial: Trial, tmp_path: Path) -> None:
    finished(tmp_path / "run")

    def whole(folder: Path) -> None:
        assert (folder / "run/report.html").read_text(encoding="utf-8").endswith("</html>\n")

    if kind == "mkdir":
        return  # it makes no folder
    command = ["report", str(tmp_path / "run")]
    before = state(tmp_path)
    for shim in each_failure(kind, tmp_path):
        code = answer(command)
        shim.over = True
        said = trial.capsys.readouterr().err
        assert "Traceback" not in said
        assert "internal error" not in said
        written(tmp_path)
        if code == 0:
            whole(tmp_path)
        else:
            assert code == 2
            assert len(said.splitlines()) == 1, said
        page = tmp_path / "run/report.html"
        if page.exists():  # the page may be whole though the manifest was not
            whole(tmp_path)
        after = state(tmp_path)
        assert {name for name in after if ".partial-" in name} == set()
        assert all(after[name] == one for name, one in before.items() if name != "run/manifest.txt"), (
            shim.number
        )
        page.unlink(missing_ok=True)


@pytest.mark.parametrize("kind", OPERATIONS)
@pytest.mark.parametrize("form", ["ply", "vtp", "opencarp", "openep"])
def test_export(form: str, kind: str, trial: Trial, tmp_path: Path) -> None:
    run = finished(tmp_path / "run")
    suffix = {"opencarp": ".pts", "openep": ".mat"}.get(form, f".{form}")
    out = tmp_path / f"out/a{suffix}"
    out.parent.mkdir()
    out.with_name("other").write_text("old")
    command = ["export", str(run), "--format", form, "--out", str(out)]

    def whole(folder: Path) -> None:
        assert out.is_file()
        assert out.with_name(out.name + ".json").is_file()

    trial(kind, command, whole, shim_folder=out.parent)


@pytest.mark.parametrize("kind", OPERATIONS)
def test_convert(kind: str, trial: Trial, tmp_path: Path) -> None:
    surface = ball_case().prior
    write_surface(tmp_path / "a.ply", surface)
    command = ["convert", str(tmp_path / "a.ply"), str(tmp_path / "b.stl")]

    def whole(folder: Path) -> None:
        assert len(read_surface(folder / "b.stl").faces) == len(surface.faces)

    trial(kind, command, whole)


@pytest.mark.parametrize("kind", OPERATIONS)
def test_import(kind: str, trial: Trial, tmp_path: Path) -> None:
    study = carto_folder(tmp_path / "study")
    command = ["import", str(study), str(tmp_path / "case"), "--map", "1-Map"]

    def whole(folder: Path) -> None:
        assert missing(folder / "case") == []

    assert trial(kind, command, whole) > 1


@pytest.mark.parametrize("kind", OPERATIONS)
def test_init(kind: str, trial: Trial, tmp_path: Path) -> None:
    write_case(tmp_path / "ball", ball_case())
    prior, points = (str(tmp_path / "ball" / name) for name in ("prior.ply", "points.csv"))
    command = ["init", str(tmp_path / "case"), "--prior", prior, "--points", points]

    def whole(folder: Path) -> None:
        assert missing(folder / "case") == []
        read_case(folder / "case")

    assert trial(kind, command, whole) > 1


@pytest.mark.parametrize("kind", [*OPERATIONS, "fork"])
def test_batch(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What the batch itself does; its processes do what `run` does. A run that is whole may stay."""
    write_case(tmp_path / "one", replace(ball_case(), name="one"))
    (tmp_path / "p.toml").write_text(PIPELINE)
    out = tmp_path / "runs"
    command = ["batch", str(tmp_path / "one"), "--pipeline", str(tmp_path / "p.toml"), "--out", str(out)]
    for shim in each_failure(kind, out):
        code = answer(command)
        shim.over = True
        said = capsys.readouterr().err
        assert code in (0, 1, 2)
        assert "Traceback" not in said, said
        assert "internal error" not in said, said
        left = [path.name for path in out.iterdir()] if out.exists() else []
        assert not [name for name in left if ".partial-" in name], left
        if "one" in left:
            written(out, "one")
        if "cohort.csv" in left:
            assert (out / "cohort.csv").read_text().endswith("\n")
        if "cohort.html" in left:
            assert (out / "cohort.html").read_text(encoding="utf-8").endswith("</html>\n")
    assert {"one", "cohort.csv", "cohort.html"} <= {path.name for path in out.iterdir()}


@pytest.mark.parametrize("kind", OPERATIONS)
def test_app(kind: str, tmp_path: Path) -> None:
    """A file is brought whole or not at all, and the next one is; what else the app writes, commands do."""
    content, failures = b"x,y,z\n" + b"1,2,3\n" * 2000, 0
    with served(tmp_path / "studies") as app:
        files = app.folder / "files"
        for shim in each_failure(kind, app.folder):
            name = f"map_{shim.number}.csv"
            code, said, _ = app.ask("PUT", f"/files/{name}", content)
            shim.over = True
            kept = [path.name for path in files.iterdir()] if files.exists() else []
            failures += code != 200
            assert "Traceback" not in said, said
            assert code in (200, 422), said
            assert (name in kept) == (code == 200), (said, kept)
            assert set(kept) <= {name}, kept
            if name in kept:
                assert (files / name).read_bytes() == content
                (files / name).unlink()
            assert app.ask("PUT", f"/files/after_{name}", content)[0] == 200
            (files / f"after_{name}").unlink()
            files.rmdir()
    assert failures > 0


def journal_case(folder: Path) -> Case:
    case = ball_case(0)
    write_case(folder, replace(case, points=case.points.of("landmark"), init=np.eye(4), truth=None))
    return read_case(folder, fewest=0)


@pytest.mark.parametrize("kind", OPERATIONS)
def test_live(kind: str, tmp_path: Path) -> None:
    """A session begins, takes points and ends; what was acknowledged is in the journal, whatever failed."""
    journal_case(tmp_path / "ball")
    record = tmp_path / "record"
    acknowledged = 0
    for _ in each_failure(kind, record):
        for path in record.iterdir() if record.is_dir() else ():
            path.unlink()
        acknowledged = 0
        try:
            journal, _ = open_record(record, tmp_path / "ball")
        except (InputError, OSError):
            if list(record.glob("*")):  # it was begun, and could not be opened
                assert len(read_journal(record / "journal.jsonl").actions) > 1
            continue
        begun = len(journal.actions)
        for k in range(3):
            try:
                journal.append({"do": "take", "type": "eam", "values": {}, "xyz": [float(k), 0.0, 0.0]})
                acknowledged += 1
            except InputError:
                pass
        journal.close()
        found = read_journal(record / "journal.jsonl")
        assert not found.cut
        assert len(found.actions) == begun + acknowledged
        assert [path.name for path in record.iterdir()] == ["journal.jsonl"]
    assert acknowledged == 3
