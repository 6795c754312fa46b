"""Where the prior is placed: by pairs, by a search, by hand; what is written is the pose that was shown."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from o3dls.arrays import Array
from o3dls.geometry.similarity import apply
from o3dls.io.case_reader import read_case
from o3dls.io.surfaces import read_surface, write_surface
from o3dls.resources import demo_case
from tests.app import visited
from tests.app.hand import Hand, ready, says
from tests.app.served import Served, served
from tests.browser import Visit, violations
from tests.viewer import FIXTURES

_, _, launch, browser, _ = FIXTURES
app, visit = visited.FIXTURES

MOVED = np.array([[0.0, -1, 0, 300], [1, 0, 0, -20], [0, 0, 1, 7], [0, 0, 0, 1]])


def case_away(app: Served) -> str:
    """A case without landmarks whose prior is far away and turned; its path."""
    folder = app.folder / "cases" / "away"
    folder.mkdir(parents=True)
    prior = read_surface(demo_case() / "prior.ply")
    write_surface(folder / "prior.ply", prior.with_vertices(apply(np.linalg.inv(MOVED), prior.vertices)))
    shutil.copy(demo_case() / "points.csv", folder)
    return "cases/away"


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """An app that is asked without a browser."""
    with served(tmp_path_factory.mktemp("asked")) as made:
        case_away(made)
        yield made


def pairs_of(rows: list[int]) -> list[dict[str, list[float]]]:
    places = read_surface(demo_case() / "prior.ply").vertices[rows]
    away: Array = apply(np.linalg.inv(MOVED), places)
    return [{"prior": a.tolist(), "map": b.tolist()} for a, b in zip(away, places, strict=True)]


def test_pairs_give_a_pose_and_say_their_errors(asked: Served) -> None:
    pairs = pairs_of([10, 900, 2500, 4000])
    assert "at least 3" in asked.act("/fit", {"pairs": pairs[:2]})["error"]
    found = asked.act("/fit", {"pairs": pairs})
    assert max(*found["misses"], *found["left_out"]) < 1e-6
    assert np.allclose(found["T"], MOVED)
    pairs[0]["map"][0] += 9.0
    found = asked.act("/fit", {"pairs": pairs})
    assert found["left_out"][0] == pytest.approx(9.0)  # what the others alone say of it
    assert found["misses"][0] < 9.0


@pytest.mark.parametrize(
    "T", [None, "x", [[1.0]], np.zeros((4, 4)).tolist(), np.diag([1, 1, -1, 1]).tolist()]
)
def test_what_is_no_pose_is_refused(asked: Served, T: object) -> None:
    for path in ("/place", "/pose"):
        assert asked.act(path, {"case": "cases/away", "T": T})["error"].startswith("T: must be a pose")
    assert not (asked.folder / "cases" / "away" / "init.csv").exists()


def test_the_points_are_sure_of_the_right_pose_alone(asked: Served) -> None:
    right = asked.act("/pose", {"case": "cases/away", "T": MOVED.tolist()})
    assert right["confidence"] > 0.95
    assert right["said"] == "The points fit this pose with confidence 1.00."
    turned = MOVED @ np.diag([-1.0, -1.0, 1.0, 1.0])
    wrong = asked.act("/pose", {"case": "cases/away", "T": turned.tolist()})
    assert wrong["confidence"] < 0.5
    assert "look whether" in wrong["said"]
    found = asked.act("/pose", {"case": "cases/away"})
    assert found["confidence"] > 0.95
    assert np.abs(np.array(found["T"])[:3, :3] - MOVED[:3, :3]).max() < 0.25


def test_the_prior_follows_pairs_by_keyboard_and_they_are_undone(visit: Visit, app: Served) -> None:
    page = visit.page
    page.goto(f"http://{app.host}/case?folder={case_away(app)}")
    ready(visit)
    assert page.locator("#place").is_disabled()
    assert violations(visit) == []
    page.select_option("#pair-name", "LSPV")
    page.get_by_role("button", name="Take the middle of the picture").press("Enter")
    assert page.locator("#pair-now").inner_text() != "0 pairs."
    page.click("#undo-pair")
    assert page.locator("#pair-now").inner_text() == "0 pairs."
    page.evaluate(
        """pairs => {
            for (const { prior, map } of pairs) {
                takePick({ kind: "prior", at: inMap(prior) });
                takePick({ kind: "map", at: map });
            }
            function inMap([x, y, z]) {
                return proposal.shown.slice(0, 3).map(([a, b, c, d]) => a * x + b * y + c * z + d);
            }
        }""",
        pairs_of([10, 900, 2500, 4000]),
    )
    says(visit, "#pairs", "LSPV: 0.0 mm off, 0.0 mm where the others alone give the pose")
    assert page.locator("[name=shown][value=over]").is_checked()
    says(visit, "#fitted", "The fit of 4 pairs: half of the mapping points are within")
    says(visit, "#sure", "The points fit this pose with confidence 1.00")
    page.click("#undo-pair")
    says(visit, "#pair-now", "3 pairs.")
    assert "alone" not in page.locator("#pairs").inner_text()  # two others give no pose
    page.click("#place")
    says(visit, "#placing", "pose from the case's init matrix")
    found = read_case(app.folder / "cases" / "away").init
    assert found is not None
    assert np.abs(found - MOVED).max() < 1e-4  # of a picture in single precision


def test_the_prior_is_moved_and_turned_by_hand(visit: Visit, app: Served) -> None:
    page = visit.page
    page.goto(f"http://{app.host}/case?folder={case_away(app)}")
    ready(visit)
    page.click("#hand summary")
    begin = np.array(page.evaluate("proposal.T"))
    page.get_by_role("button", name="→ right", exact=True).press("Enter")
    moved = np.array(page.evaluate("proposal.T"))
    assert np.linalg.norm(moved[:3, 3] - begin[:3, 3]) == pytest.approx(5.0, abs=1e-3)
    assert np.allclose(moved[:3, :3], begin[:3, :3])
    says(visit, "#fitted", "The pose by hand")
    view = page.locator("#panels").get_attribute("data-looks-from")
    page.check("[name=hand][value=turn]")
    assert violations(visit) == []
    box = page.locator("#panels canvas").bounding_box()
    middle = [box["x"] + box["width"] / 2, box["y"] + box["height"] / 2]
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0] + 80, middle[1], steps=4)
    page.mouse.up()
    turned = np.array(page.evaluate("proposal.T"))
    degrees = np.degrees(np.arccos((np.trace(turned[:3, :3] @ moved[:3, :3].T) - 1.0) / 2.0))
    assert 10.0 < degrees < 60.0
    assert page.locator("#panels").get_attribute("data-looks-from") == view  # the view stays
    page.click("#fuse")
    says(visit, "#fused", "The pose in the picture is not kept")
    assert app.desk.job is None
    page.click("#place")
    says(visit, "#placing", "pose from the case's init matrix")
    found = read_case(app.folder / "cases" / "away").init
    assert found is not None
    assert np.allclose(found, turned)


def test_every_answer_to_a_question_has_its_picture(visit: Visit, app: Served, tmp_path: Path) -> None:
    """Units, labels, layers, axes, columns and maps; openings have one answer, and its picture."""
    from tests.app.inputs import (
        atrium,
        bare_volume,
        carto_zip,
        german_table,
        label_volume,
        layered_volume,
    )

    hand, prior = Hand(visit), read_surface(demo_case() / "prior.ply")
    write_surface(tmp_path / "small.stl", prior.with_vertices(prior.vertices / 1000.0))
    write_surface(tmp_path / "open.ply", type(prior)(prior.vertices, prior.faces[10:]))
    for role, path, sizes in (
        ("prior", tmp_path / "small.stl", ["42.9 ml", "0.0 ml"]),
        ("prior", tmp_path / "open.ply", ["42.9 ml"]),
        ("prior", label_volume(tmp_path / "labels.nii.gz", prior), ["42.7 ml", "0.0 ml"]),
        ("prior", layered_volume(tmp_path / "layers.nii.gz", prior), ["42.7 ml", "42.7 ml"]),
        ("prior", bare_volume(tmp_path / "bare.nrrd", prior), ["42.7 ml", "42.7 ml"]),
        ("map", german_table(tmp_path / "p.csv", atrium().points.of("eam")), ["75 × 47 × 53 mm"]),
        ("map", carto_zip(tmp_path, atrium().points.of("eam")), ["75 × 47 × 53 mm", "mm"]),
    ):
        hand.drop(role, path)
        for size in sizes:
            hand.sees(f"#{role} .choice", size)
        shown = visit.page.locator(f"#{role} .choice img")
        shown.nth(len(sizes) - 1).wait_for()
        assert shown.count() == len(sizes), path
        assert shown.evaluate_all("all => all.every(one => one.naturalWidth > 0)")
        assert violations(visit) == []


def test_an_answer_goes_with_its_file(visit: Visit, app: Served, tmp_path: Path) -> None:
    """What was said of one file is not said of the next one in its place."""
    from tests.app.inputs import atrium, label_volume

    hand = Hand(visit)
    hand.drop("prior", label_volume(tmp_path / "labels.nii.gz", atrium().prior))
    hand.press("label 1")
    hand.sees("#prior .read", "ml")
    hand.drop("prior", demo_case() / "prior.ply")
    hand.sees("#prior .read", "42.9 ml")
    assert re.search("label", visit.page.locator("#prior .said").inner_text()) is None
