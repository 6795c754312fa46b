"""Cross-sections: one scale, sides that are named where they are known, and what is said of each in words."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from o3dls.case import Case
from o3dls.geometry.similarity import similarity
from o3dls.geometry.surface import Surface
from o3dls.report.drawing.slices import Frame, Outline, bar_length, drawing, slice_surface
from o3dls.report.sections.cross_sections import BESIDE, slice_section
from o3dls.report.sections.outlines import outline_section
from o3dls.report.subject import Subject, read_subject
from tests.chamber import chamber
from tests.finished import bulged_case, finished, finished_2d
from tests.tiny import sphere

QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def two_balls() -> Surface:
    one = sphere(10.0, 20)
    beside = one.vertices + np.array([30.0, 0.0, 0.0])
    return Surface(np.vstack([one.vertices, beside]), np.vstack([one.faces, one.faces + len(beside)]))


def subject_of(case: Case, folder: Path) -> Subject:
    return read_subject([finished(folder, case)])


def section_of(subject: Subject) -> str:
    section = slice_section(subject)
    assert section is not None
    return section.html()


def figures(html: str) -> list[str]:
    return re.findall(r"<figure.*?</figure>", html)


def texts(figure: str) -> list[str]:
    """The words in a picture with their places, from left to right and from above."""
    return re.findall(r"<text[^>]*>([^<]*)</text>", figure)


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Subject:
    return subject_of(bulged_case(), tmp_path_factory.mktemp("known") / "run")


def test_all_are_on_one_scale_with_a_bar_of_a_round_length(known: Subject) -> None:
    drawn = figures(section_of(known))
    assert len(drawn) == 3
    assert len({re.search(r'viewBox="([^"]*)"', one)[1] for one in drawn}) == 1  # type: ignore[index]
    bars = {re.search(r'd="M12 18v8M12 22H([\d.]+)', one)[1] for one in drawn}  # type: ignore[index]
    # A ball of radius 20 mm that bulges by 3 mm, on 396 pixels with 3 % on either side. It is drawn by its
    # facets, up to 5 % less wide where a plane does not meet their corners.
    assert len(bars) == 1
    assert all("10 mm" in texts(one) for one in drawn)
    assert float(bars.pop()) - 12 == pytest.approx(396 * 10 / (43 * 1.06), rel=0.05)


@pytest.mark.parametrize("width", [0.3, 1.0, 44.0, 60.0, 99.0, 512.0])
def test_the_bar_is_a_part_of_the_picture(width: float) -> None:
    length = bar_length(width)
    assert width / 9 < length <= width / 3.5
    assert f"{length:.0e}"[0] in "125"


def bulge_at(figure: str) -> float:
    """Where the last estimate, which bulges, has its middle against the prior, in pixels to the right."""
    paths = re.findall(r'<path d="([^"]*)" class="series ([^"]*)">', figure)
    places = {
        kind: np.array([[float(x), float(y)] for x, y in re.findall(r"([\d.]+) ([\d.]+)", line)])
        for line, kind in paths
    }
    middle = {kind: (at.min(axis=0) + at.max(axis=0)) / 2 for kind, at in places.items()}
    return float((middle["s0 d0"] - middle["prior"])[0])


@pytest.mark.parametrize("frame", ["LPS", "RAS"])
def test_the_left_of_the_patient_is_on_the_right(frame: str, tmp_path: Path) -> None:
    """The ball bulges towards +x: the patient's left in LPS, the right in RAS."""
    _, coronal, axial = figures(section_of(subject_of(replace(bulged_case(), frame=frame), tmp_path / "run")))
    for picture in (coronal, axial):
        assert (bulge_at(picture) > 3) == (frame == "LPS")
        assert (bulge_at(picture) < -3) == (frame == "RAS")
    assert texts(coronal)[1:] == ["← right", "left →", "feet ↓", "head ↑"]
    assert texts(axial)[1:] == ["← right", "left →", "back ↓", "front ↑"]


def test_the_front_is_on_the_right_of_a_sagittal_section(known: Subject) -> None:
    assert texts(figures(section_of(known))[0])[1:] == ["← back", "front →", "feet ↓", "head ↑"]


def test_where_the_axes_are_not_known_those_of_the_prior_are_named(tmp_path: Path) -> None:
    """A frame that is not known is not taken for LPS."""
    case = replace(bulged_case(), frame="unknown")
    marks = case.points.type == "landmark"  # two veins and no third: no axes
    case = replace(case, points=case.points.select(~marks), prior_landmarks={})
    html = section_of(subject_of(case, tmp_path / "run"))
    assert not re.search(r"left|front|head|sagittal|axial", html)
    across_z = figures(html)[2]
    assert "across the prior&#x27;s z axis" in across_z
    assert texts(across_z)[1:] == ["← side 4", "side 3 →", "side 2 ↓", "side 1 ↑"]


def test_sections_turn_with_the_prior_where_it_knows_the_axes(tmp_path: Path) -> None:
    """A map turned by a quarter about z: the planes are still those of the patient."""
    case = bulged_case()
    turned = similarity(QUARTER, np.zeros(3))
    moved = replace(
        case,
        frame="unknown",
        prior_frame="LPS",
        points=replace(case.points, xyz=case.points.xyz @ QUARTER.T),
        truth=None,
    )
    subject = subject_of(moved, tmp_path / "run")
    last = subject.last
    run = replace(
        last.run,
        estimates={
            **last.run.estimates,
            last.key: replace(
                last.estimate,
                T_map_prior=turned,
                surface=last.estimate.surface.transformed(turned),
            ),
        },
    )
    results = {**subject.results, last.name: replace(last, run=run)}
    coronal = figures(section_of(replace(subject, results=results)))[1]
    assert bulge_at(coronal) > 3
    assert texts(coronal)[1:3] == ["← right", "left →"]


def test_the_prior_is_dashed_and_its_pose_is_named(known: Subject) -> None:
    html = section_of(known)
    assert all('class="series prior"' in one for one in figures(html))
    assert "prior, in the pose of level_set" in html


def test_what_a_picture_shows_is_said_in_words(known: Subject) -> None:
    sagittal, _, axial = figures(section_of(known))
    # the section x = middle of the bulge: a circle of the truth itself, which the level set hits
    assert "truth 0.00 mm" in sagittal
    at = known.last.estimate.surface.vertices[:, 2]
    eam = known.case.points.of("eam").xyz[:, 2]
    level = (at.min() + at.max()) / 2
    count = int((np.abs(eam - level) < BESIDE).sum())
    assert f"{count} points within 2 mm" in axial
    assert axial.count("<circle") == count
    # from 0 to 3 mm over the right half, 0 over the left: less than half of 3 mm on the whole
    gap = re.search(r"Mean distance from level_set here to: prior ([\d.]+) mm, truth", axial)
    assert gap is not None
    assert 0.3 < float(gap[1]) < 1.5


def test_points_outside_a_picture_are_counted(tmp_path: Path) -> None:
    case = bulged_case()
    xyz = case.points.xyz.copy()
    xyz[5] = [0.0, 90.0, 0.0]
    subject = subject_of(replace(case, points=replace(case.points, xyz=xyz)), tmp_path / "run")
    assert "within 2 mm, 1 of them outside the picture." in figures(section_of(subject))[2]


def test_outlines_in_two_dimensions_have_a_bar_in_their_unit(tmp_path: Path) -> None:
    section = outline_section(read_subject([finished_2d(tmp_path / "run")]))
    assert section is not None
    assert re.search(r"<text[^>]*>\d+ px</text>", section.body)


@pytest.mark.parametrize(("surface", "loops"), [(sphere(20.0, 24), 1), (chamber(), 1), (two_balls(), 2)])
def test_an_outline_is_one_line_so_that_its_dashes_are_seen(surface: Surface, loops: int) -> None:
    """Dashes begin anew with every move; nothing of the outline is lost."""
    segments = slice_surface(surface, 2, 0.37)
    low, high = segments.reshape(-1, 2).min(axis=0) - 1, segments.reshape(-1, 2).max(axis=0) + 1
    frame = Frame(low, high, "mm")
    page = str(drawing("", [Outline("one", "prior", segments)], np.zeros((0, 2)), [], frame))
    path = re.search(r' d="(M[^"]+)" class="series prior"', page)
    assert path
    lines = [one.split("L") for one in path[1].split("M")[1:]]
    assert len(lines) == loops
    drawn = [np.array([[float(x) for x in at.split()] for at in line]) for line in lines]
    length = sum(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in drawn)
    wanted = np.linalg.norm(np.diff(segments, axis=1)[:, 0], axis=1).sum() * frame.scale
    assert length == pytest.approx(wanted, rel=0.01)


def test_an_open_outline_is_one_line_too() -> None:
    at = np.column_stack([np.linspace(0, 10, 30), np.sin(np.linspace(0, 10, 30))])
    segments = np.random.default_rng(9_121).permutation(np.stack([at[:-1], at[1:]], axis=1))
    segments[::2] = segments[::2, ::-1]
    frame = Frame(np.array([-1.0, -2]), np.array([11.0, 2]), "mm")
    page = str(drawing("", [Outline("one", "prior", segments)], np.zeros((0, 2)), [], frame))
    path = re.search(r' d="(M[^"]+)" class="series prior"', page)
    assert path
    assert path[1].count("M") == 1
    assert path[1].count("L") == 29
