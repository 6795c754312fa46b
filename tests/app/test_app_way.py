"""The whole way by mouse: from two files to a judged surface, the same as the commands give."""

from __future__ import annotations

import base64
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest

from o3dls.case import Points
from o3dls.geometry.surface import Surface
from o3dls.io.case_reader import read_case
from o3dls.io.surfaces import read_surface, write_surface
from o3dls.levelset.grid.distance import filled_distance
from o3dls.resources import demo_case
from tests.app.served import Served, served
from tests.browser import Visit, violations
from tests.formats import car_file
from tests.viewer import FIXTURES

_, _, launch, browser, _ = FIXTURES

READ = 30_000  # ms
RUN = 500_000  # ms, of a whole run on cores that others use too


@pytest.fixture
def app(tmp_path: Path) -> Iterator[Served]:
    with served(tmp_path / "work") as made:
        yield made


@pytest.fixture
def visit(browser: Any, app: Served) -> Iterator[Visit]:
    opened = Visit(browser, app.server.url, wait=False)
    yield opened
    # the first is said of these tests, the second of what the server asks about
    known = ("willReadFrequently", "status of 422")
    assert [text for text in opened.errors if not any(one in text for one in known)] == []
    own = f"http://{app.host}/"
    assert [url for url in opened.requests if not url.startswith((own, "blob:", "data:"))] == []
    opened.page.close()


def says(visit: Visit, selector: str, text: str, patience: int = READ) -> None:
    """Wait until an element says a text."""
    visit.page.locator(selector, has_text=re.compile(re.escape(text))).first.wait_for(timeout=patience)


def command(folder: Path, *arguments: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "o3dls", *arguments], cwd=folder, capture_output=True, text=True, timeout=500
    )
    assert done.returncode == 0, done.stderr


def final_surface(run: Path) -> bytes:
    found = list(run.glob("estimates/level_set/surface.ply"))
    assert len(found) == 1
    return found[0].read_bytes()


def test_the_way_from_a_table_and_an_stl_to_a_judged_surface(
    visit: Visit, app: Served, tmp_path: Path
) -> None:
    page = visit.page
    write_surface(tmp_path / "atrium.stl", read_surface(demo_case() / "prior.ply"))
    says(visit, "#there", "There is no case here yet.")
    page.set_input_files("#prior-file", tmp_path / "atrium.stl")
    says(visit, "#prior .read", "42.9 ml")
    assert page.locator("#prior .read img").evaluate("one => one.naturalWidth") > 0
    page.set_input_files("#map-file", demo_case() / "points.csv")
    says(visit, "#map .read", "250 eam, 40 ablation, 4 landmark")
    page.set_input_files("#landmarks-file", demo_case() / "prior_landmarks.csv")
    says(visit, "#landmarks .read", "LSPV, LIPV, RSPV, RIPV")
    page.fill("#name", "first")
    assert violations(visit) == []
    page.click("#make")
    says(visit, "#placing", "rigid fit of 4 landmarks", patience=READ)
    page.wait_for_function("() => document.documentElement.dataset.ready !== undefined", timeout=READ)
    page.check("[name=preset][value=quick]")
    page.click("#fuse")
    says(visit, "#fused", "The run is done.", patience=RUN)
    assert violations(visit) == []
    page.click("text=Judge it")
    says(visit, "#judge", "case first")
    page.click("[data-export=ply]")
    says(visit, "#take", "runs/first-quick/export/level_set.ply")
    with page.expect_download() as loaded:
        page.click("text=runs/first-quick/export/level_set.ply")
    assert Path(loaded.value.path()).read_bytes().startswith(b"ply")
    says(visit, "#commands", "o3dls export runs/first-quick --format ply")
    assert violations(visit) == []
    page.click("text=Open the report")
    page.wait_for_function("() => document.documentElement.dataset.ready !== undefined", timeout=READ)
    assert page.locator("h1").inner_text() == "first"
    assert page.evaluate("origin") == "null"  # a report of others may ask the app nothing
    # the case folder that was made is one of the command line, and gives the same surface there
    command(app.folder, "run", "--case", "cases/first", "--out", "again", "--set", "folds=0", "--quiet")
    assert final_surface(app.folder / "again") == final_surface(app.folder / "runs" / "first-quick")


def carto_zip(folder: Path, points: Points) -> Path:
    """A zipped study of CARTO with these points as map 1-LA, and ten of them as another."""
    few = Points(points.xyz[:10], points.type[:10], {k: v[:10] for k, v in points.columns.items()})
    maps = {"1-LA": points, "2-RA": few}
    named = "".join(
        f'<Map Name="{name}" FileNames="{name}.mesh" Volume="0"><CartoPoints Count="{len(of)}">'
        + "".join(f'<Point Id="{k}" />' for k in range(1, len(of) + 1))
        + "</CartoPoints></Map>"
        for name, of in maps.items()
    )
    head = '<Study name="S"><Units Distance="mm" Angle="radian" />'
    path = folder / "study.zip"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("S/Study 1.xml", f'{head}<Maps Count="2">{named}</Maps></Study>')
        for name, of in maps.items():
            file.writestr(f"S/{name}_car.txt", car_file(name, of))
    return path


def label_volume(path: Path, prior: Surface) -> Path:
    """The prior as label 1 of a volume, and a small ball as label 2."""
    found = filled_distance(prior.vertices, prior.faces, 1.0, 3)
    labels = np.zeros(found.band.shape, dtype=np.uint8)
    labels[tuple(found.band.nodes[found.phi < 0.0].T)] = 1
    labels[:3, :3, :3] = 2
    affine = np.diag([-1.0, -1.0, 1.0, 1.0])
    affine[:3, 3] = np.array([-1.0, -1.0, 1.0]) * found.band.origin
    nibabel.save(nibabel.Nifti1Image(labels, affine), path)
    return path


def test_the_way_from_a_carto_zip_and_a_label_volume(visit: Visit, app: Served, tmp_path: Path) -> None:
    page = visit.page
    case = read_case(demo_case())
    page.set_input_files("#prior-file", label_volume(tmp_path / "labels.nii.gz", case.prior))
    says(visit, "#prior .question", "holds 2 labels")
    assert violations(visit) == []
    page.get_by_role("button", name="label 1", exact=True).click()
    says(visit, "#prior .read", "ml")
    page.set_input_files("#map-file", carto_zip(tmp_path, case.points.of("eam")))
    says(visit, "#map .question", "2 maps with points")
    page.get_by_role("button", name="1-LA, 250 points", exact=True).click()
    says(visit, "#map .read", "CARTO 3, map 1-LA")
    page.fill("#name", "study")
    page.click("#make")
    says(visit, "#placing", "The prior is used as it stands")
    page.check("[name=preset][value=quick]")
    page.click("#fuse")
    says(visit, "#fused", "The run is done.", patience=RUN)
    page.reload()
    says(visit, "#judge", "runs/study-quick")
    page.locator("#judge .grade:not([data-grade=''])[data-grade]").wait_for(timeout=READ)
    assert page.locator("#judge .runs img").evaluate("one => one.naturalWidth") > 0
    page.click("#judge >> text=runs/study-quick")
    says(visit, "#judge", "case 1-LA")
    command(app.folder, "run", "--case", "cases/study", "--out", "again", "--set", "folds=0", "--quiet")
    assert final_surface(app.folder / "again") == final_surface(app.folder / "runs" / "study-quick")


def drop(visit: Visit, role: str, name: str, content: bytes) -> None:
    """Drop a file onto the place of its role, as a mouse does."""
    visit.page.evaluate(
        """([role, name, text]) => {
            const data = new DataTransfer();
            data.items.add(new File([Uint8Array.from(atob(text), one => one.charCodeAt(0))], name));
            const slot = document.getElementById(role);
            const how = { dataTransfer: data, bubbles: true, cancelable: true };
            for (const kind of ["dragover", "drop"]) slot.dispatchEvent(new DragEvent(kind, how));
        }""",
        [role, name, base64.b64encode(content).decode()],
    )


def test_wrong_files_that_are_dropped_end_in_a_sentence_or_a_choice(
    visit: Visit, app: Served, shared_data: Path
) -> None:
    reports = shared_data / "reports"
    closed = "#{} .question:not([hidden]) button, #{} .said.refused:not(:empty)"
    for role, path, said in (
        ("prior", "07-qform-against-sform/mirrored.nii", "the sform is right"),
        ("prior", "04-wall-taken-for-the-chamber/wall.nii.gz", "label 2"),
        ("prior", "23-nifti-units-dead-end/says_um.nii", "its units are"),
        ("prior", "11-points-only-as-one-kind-of-csv/cloud.xyz", "is not a surface"),
        ("map", "07-qform-against-sform/mirrored.nii", "is binary where text was expected"),
        ("landmarks", "17-cap-on-a-soup/soup.stl", "is binary where text was expected"),
    ):
        drop(visit, role, Path(path).name, (reports / path).read_bytes())
        says(visit, f"#{role}", said)
        visit.page.locator(closed.format(role, role)).first.wait_for(timeout=READ)
        assert visit.page.locator(f"#{role} .read dl").count() == 0
    drop(visit, "map", "points.csv", (demo_case() / "points.csv").read_bytes())
    says(visit, "#map .read", "250 eam")  # the page goes on


def test_pairs_are_clicked_until_they_place_the_prior(visit: Visit, app: Served, tmp_path: Path) -> None:
    page = visit.page
    prior = read_surface(demo_case() / "prior.ply")
    write_surface(tmp_path / "away.ply", prior.with_vertices(prior.vertices[:, [1, 2, 0]] + 300.0))
    page.set_input_files("#prior-file", tmp_path / "away.ply")
    says(visit, "#prior .read", "42.9 ml")
    page.set_input_files("#map-file", demo_case() / "points.csv")
    says(visit, "#map .read", "250 eam")
    page.fill("#name", "away")
    page.click("#make")
    says(visit, "#placing", "Nothing says yet where the prior stands")
    page.wait_for_function("() => document.documentElement.dataset.ready !== undefined", timeout=READ)
    assert page.locator("#place").is_disabled()
    assert violations(visit) == []
    page.get_by_role("button", name="Take the middle of the picture").press("Enter")  # without a mouse
    assert page.locator("#pair-now").inner_text() != "0 pairs."
    page.click("#undo-pair")
    box = page.locator("#panels canvas").bounding_box()
    places = [(x, y) for y in np.linspace(0.3, 0.7, 7) for x in np.linspace(0.1, 0.9, 16)]
    for x, y in places:  # from the prior to the points beside it, and back
        page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
        if page.locator("#place").is_enabled():
            break
    says(visit, "#pairs", "mm off")
    page.click("#place")
    says(visit, "#placing", "pose from the case's init matrix")
    assert read_case(app.folder / "cases" / "away").init is not None
