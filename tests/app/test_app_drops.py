"""What is dropped on the page: wrong files, folders, and an image of the prior."""

from __future__ import annotations

from pathlib import Path

from o3dls.resources import demo_case
from tests.app import visited
from tests.app.hand import READ, Hand
from tests.app.served import Served
from tests.browser import Visit
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
