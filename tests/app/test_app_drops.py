"""What is dropped on the page: wrong files, folders, and an image of the prior."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from o3dls.io.points import write_points
from o3dls.io.surfaces import write_surface
from o3dls.resources import demo_case
from tests.app import visited
from tests.app.hand import READ, Hand, ready
from tests.app.inputs import atrium, carto_zip
from tests.app.served import Served
from tests.browser import Visit, violations
from tests.finished import bulged_case
from tests.oblique import ball_image, write
from tests.viewer import FIXTURES

_, _, launch, browser, _ = FIXTURES
app, visit = visited.FIXTURES


def test_wrong_files_that_are_dropped_end_in_a_sentence_or_a_choice(
    visit: Visit, app: Served, shared_data: Path
) -> None:
    hand, reports = Hand(visit), shared_data / "reports"
    closed = "#{} .question:not([hidden]) button, #{} .said.refused:not(:empty)"
    for role, path, said in (
        ("prior", "07-qform-against-sform/mirrored.nii", "the sform is right"),
        ("prior", "04-wall-taken-for-the-chamber/wall.nii.gz", "label 2"),
        ("prior", "23-nifti-units-dead-end/says_um.nii", "its units are"),
        ("prior", "11-points-only-as-one-kind-of-csv/cloud.xyz", "is not a surface"),
        ("map", "07-qform-against-sform/mirrored.nii", "is binary where text was expected"),
        ("landmarks", "17-cap-on-a-soup/soup.stl", "is binary where text was expected"),
    ):
        hand.drop(role, reports / path)
        hand.sees(f"#{role}", said)
        visit.page.locator(closed.format(role, role)).first.wait_for(timeout=READ)
        assert visit.page.locator(f"#{role} .read dl").count() == 0
    hand.drop("map", demo_case() / "points.csv")
    hand.sees("#map .read", "250 eam")  # the page goes on


def test_a_folder_is_brought_as_a_study(visit: Visit, app: Served, tmp_path: Path) -> None:
    """Chosen, and dropped; where a file is meant, a folder is refused with a sentence."""
    with zipfile.ZipFile(carto_zip(tmp_path, atrium().points.of("eam"), maps=1)) as packed:
        packed.extractall(tmp_path)
    hand = Hand(visit)
    visit.page.set_input_files("#map-folder", tmp_path / "S")
    hand.sees("#map .read", "CARTO 3, map 1-LA")
    with zipfile.ZipFile(app.folder / "files" / "S.zip") as brought:
        assert brought.testzip() is None
        assert {Path(name).name for name in brought.namelist()} == {"Study 1.xml", "1-LA_car.txt"}
    for role, said in (("map", "CARTO 3, map 1-LA"), ("prior", "S: is a folder; drop the one file")):
        drop_folder(visit, role, tmp_path / "S")
        hand.sees(f"#{role}", said)
    assert [path.name for path in (app.folder / "files").iterdir()] == ["S.zip"]  # the same is kept once


def drop_folder(visit: Visit, role: str, folder: Path) -> None:
    """Drop a folder: a browser makes entries of folders for a real drop alone, so here they are made up."""
    visit.page.evaluate(
        """([role, name, files]) => {
            const entries = files.map(([title, text]) => ({
                isFile: true, fullPath: `/${name}/${title}`, file: (done) => done(new File([text], title)),
            }));
            const readEntries = (done) => done(entries.splice(0, 1)); // a part at a time
            const entry = { isDirectory: true, name, createReader: () => ({ readEntries }) };
            const dataTransfer = { items: [{ webkitGetAsEntry: () => entry }], files: [] };
            const event = new Event("drop", { bubbles: true, cancelable: true });
            document.getElementById(role).dispatchEvent(Object.assign(event, { dataTransfer }));
        }""",
        [role, folder.name, [[path.name, path.read_bytes().decode()] for path in sorted(folder.iterdir())]],
    )


def test_an_image_is_a_file_or_a_folder_of_slices(visit: Visit, app: Served, tmp_path: Path) -> None:
    pytest.importorskip("pydicom", reason="a DICOM series needs pydicom: pip install 'o3dls[dicom]'")
    hand = Hand(visit)
    hand.drop("image", write(tmp_path, "image.nii.gz", ball_image()))
    hand.sees("#image .read", "Spacing")
    visit.page.set_input_files("#image-folder", write(tmp_path, "series", ball_image()))
    hand.sees("#image .said", "Read: files/series")
    hand.sees("#image .read", "LPS")
    assert visit.page.locator("#image .read img").evaluate("one => one.naturalWidth") > 0
    assert len(list((app.folder / "files" / "series").glob("*.dcm"))) > 10
    prior = tmp_path / "prior.ply"
    write_surface(prior, bulged_case().prior, space="LPS", units="mm")
    hand.drop("prior", prior)
    hand.sees("#prior .read", "ml")
    write_points(tmp_path / "points.csv", bulged_case().points.of("eam"), space="LPS", units="mm")
    hand.drop("map", tmp_path / "points.csv")
    hand.sees("#map .read", "eam")
    hand.click("#template")
    hand.type("#name", "grey")
    hand.click("#make")
    ready(visit)
    settings = (app.folder / "cases" / "grey" / "case.toml").read_text()
    assert 'image = "../../files/series"' in settings
    assert 'prior_of = "template"' in settings
    assert violations(visit) == []


def test_a_zip_without_slices_is_no_image(app: Served, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as packed:
        packed.writestr("a.txt", "no slice")
    app.put("a.zip", (tmp_path / "a.zip").read_bytes())
    assert "holds no slices of DICOM" in app.act("/unpack", {"file": "files/a.zip"})["error"]
    assert [path.name for path in (app.folder / "files").iterdir()] == ["a.zip"]
