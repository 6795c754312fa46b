"""`o3dls view`: which page is shown, and that no browser is waited for or missed in silence."""

from __future__ import annotations

import os
import sys
import time
import webbrowser
from pathlib import Path

import pytest
from click.testing import CliRunner

from o3dls.cli.commands import cli
from o3dls.cli.main import answer
from o3dls.errors import InputError
from o3dls.report import browser
from o3dls.report.browser import page_of, show
from o3dls.report.writer import write_report
from tests.finished import finished


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = finished(tmp_path_factory.mktemp("view") / "run")
    write_report([folder])
    return folder


class Opened:
    """A browser that is not there: it keeps what it was asked for."""

    def __init__(self, answer: bool = True, seconds: float = 0.0) -> None:
        self.asked: list[str] = []
        self.answer, self.seconds = answer, seconds

    def open(self, address: str) -> bool:
        time.sleep(self.seconds)
        self.asked.append(address)
        return self.answer


class Broken(Opened):
    """One that cannot be started."""

    def open(self, address: str) -> bool:
        raise OSError("no such program")


def shown_by(one: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(browser, "has_display", lambda: True)
    monkeypatch.setattr(webbrowser, "get", lambda: one)


def test_the_page_opens_at_its_pictures_and_its_path_is_printed(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = Opened()
    shown_by(there, monkeypatch)
    done = CliRunner().invoke(cli, ["view", str(run)])
    assert done.exit_code == 0
    assert Path(done.output.strip()) == run / "report.html"
    assert there.asked == [f"{(run / 'report.html').as_uri()}#pictures"]
    assert 'id="pictures"' in (run / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("kind", ["none", "older"])
def test_a_page_that_is_not_that_of_the_run_is_made_elsewhere(kind: str, tmp_path: Path) -> None:
    folder = finished(tmp_path / "run")
    if kind == "older":
        old = folder / "report.html"
        old.write_text("an earlier run")
        before = (folder / "run.json").stat().st_mtime - 1.0
        os.utime(old, (before, before))
    names = sorted(path.name for path in folder.iterdir())
    page = page_of(folder)
    assert folder not in page.parents
    assert 'id="pictures"' in page.read_text(encoding="utf-8")
    assert sorted(path.name for path in folder.iterdir()) == names
    page.unlink()
    page.parent.rmdir()


def test_what_is_no_run_is_refused_before_a_page_is_taken(tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("some page")
    with pytest.raises(InputError, match="is not a run folder"):
        page_of(tmp_path)


@pytest.mark.parametrize("why", ["refuses", "fails", "none", "text only"])
def test_where_no_browser_opens_it_is_said_what_to_do(
    why: str, run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("BROWSER", raising=False)
    kinds = {"refuses": Opened(answer=False), "fails": Broken()}
    shown_by(kinds.get(why, webbrowser.GenericBrowser("false")), monkeypatch)
    if why == "none":
        monkeypatch.setattr(webbrowser, "get", _none)
    assert answer(["view", str(run)]) == 2
    out, err = capsys.readouterr()
    assert out.strip() == str(run / "report.html")
    assert "no browser could be opened here: open" in err
    assert len(err.splitlines()) == 1


def _none() -> None:
    raise webbrowser.Error("could not locate runnable browser")


def test_without_a_display_no_browser_is_looked_for(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    there = Opened()
    monkeypatch.setattr(webbrowser, "get", lambda: there)
    with pytest.raises(InputError, match="no browser could be opened"):
        show(run / "report.html")
    assert there.asked == []
    monkeypatch.setenv("BROWSER", "mine")  # as editors on another machine set it
    show(run / "report.html")
    assert len(there.asked) == 1


def test_a_browser_that_runs_until_it_is_closed_is_not_waited_for(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown_by(Opened(seconds=60.0), monkeypatch)
    began = time.monotonic()
    show(run / "report.html", wait=0.1)
    assert time.monotonic() - began < 30.0  # far more than it takes, far less than it runs
