"""What pages of the app may reach: the files of its folder, and none beside it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from o3dls.app.desk import Desk
from o3dls.errors import InputError
from tests.app.served import Served, served
from tests.web.asking import until


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("work")) as made:
        yield made


@pytest.mark.parametrize(
    "path", ["../secret", "/etc", "cases/../../secret", "link", "link/inside", "", "a\0b", ".", "~"]
)
def test_no_path_leads_out_of_the_folder(app: Served, path: str) -> None:
    outside = app.folder.parent / "secret"
    outside.mkdir(exist_ok=True)
    for name in ("run.json", "case.toml", "prior.ply"):
        (outside / name).write_text("{}")
    with suppress(FileExistsError):
        (app.folder / "link").symlink_to(outside)
    for action, content in (
        ("/look", {"role": "prior", "file": path}),
        ("/unpack", {"file": path}),
        ("/make", {"name": "a", "prior": path, "map": path}),
        ("/fuse", {"case": path, "preset": "quick"}),
        ("/pose", {"case": path}),
        ("/live", {"case": path, "source": "igtl", "place": "localhost:1"}),
        ("/place", {"case": path, "T": np.eye(4).tolist()}),
        ("/export", {"run": path, "export": "ply"}),
    ):
        status, text, _ = app.ask("POST", action, content)
        assert (status, "error" in json.loads(text)) == (422, True), (action, text)
    quoted = path.replace("\0", "%00").replace("/", "%2F")
    for page in (
        "case?folder",
        "run?folder",
        "grade?folder",
        "glance?folder",
        "export?file",
        "cohort?folder",
    ):
        assert app.ask("GET", f"/{page}={quoted}")[0] == 422, page
    assert app.ask("GET", f"/compare?run={quoted}&run=.{quoted}")[0] == 422
    assert app.ask("GET", f"/{quoted}/report.html")[0] in (404, 422)


@pytest.mark.parametrize("name", [".hidden", "-rf", "a%00b", "%2e%2e", "a" * 200, "a%0ab", "%20", "a%5Cb"])
def test_a_file_of_no_name_is_not_kept(app: Served, name: str) -> None:
    before = sorted((app.folder / "files").glob("*"))
    status, text, _ = app.ask("PUT", f"/files/{name}", b"x")
    assert (status, "name" in text) == (422, True)
    assert sorted((app.folder / "files").glob("*")) == before


def test_a_file_is_kept_once_and_another_of_its_name_beside_it(app: Served) -> None:
    assert app.put("b.csv", b"x,y,z\n") == {"file": "files/b.csv"}
    assert app.put("b.csv", b"x,y,z\n") == {"file": "files/b.csv"}
    assert app.put("b.csv", b"x,y\n") == {"file": "files/b_2.csv"}
    assert (app.folder / "files" / "b.csv").read_bytes() == b"x,y,z\n"
    for path in (app.folder / "files").iterdir():
        path.unlink()


def test_a_file_that_breaks_off_leaves_nothing(app: Served) -> None:
    connection = app.begin("PUT", "/files/c.csv", "Content-Length: 1000\r\n\r\n" + "x" * 500)
    files = app.folder / "files"
    until(lambda: any(files.glob(".c.csv*")))
    connection.close()
    until(lambda: not list(files.iterdir()))


def test_a_folder_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        Desk(tmp_path / "none")
