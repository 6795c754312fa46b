"""Pictures without a screen: the renderer against geometry, slides that are whole, letters that the font
lacks.
"""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from o3dls.cli.main import answer
from o3dls.evaluation.distances import distances
from o3dls.geometry.surface import Surface
from o3dls.report.drawing import fields, figures, pictures
from o3dls.report.drawing.caption import made
from o3dls.report.drawing.colour_maps import MAPS, colour_table
from o3dls.report.drawing.fields import (
    Field,
    colours_of,
    known_fields,
    length_range,
    point_field,
    robust_range,
    shown_fields,
)
from o3dls.report.drawing.figures import drawable, pictures_png, plain_figure, png, shrunk
from o3dls.report.drawing.painting import plain
from o3dls.report.drawing.raster import Canvas, View
from o3dls.report.drawing.slices import slice_surface
from o3dls.report.grading.remarks import Remark
from o3dls.report.mapping.views import by_veins, in_frame, orientation
from o3dls.report.sections import slides
from o3dls.report.sections.scores import mean_table
from o3dls.report.subject import Subject, read_subject
from o3dls.report.surfaces import display
from o3dls.report.surfaces.display import decimated
from o3dls.report.verdict import verdict
from o3dls.report.writer import Report, write_report
from tests.finished import NASTY, bulged_case, fine_sphere, finished, finished_2d
from tests.tiny import sphere

WHITE = (1.0, 1.0, 1.0)
VIEW = View(in_frame("LPS").looking(), np.zeros(3), 100.0)


def test_sphere_covers_its_disc_and_is_lit_from_the_viewer() -> None:
    canvas = Canvas(VIEW, 200, 200, WHITE)
    surface = sphere(40.0, 60)
    canvas.surface(surface, plain((0.0, 0.5, 1.0)))
    picture = canvas.pixels().astype(float) / 255
    covered = (picture != 1).any(axis=2)
    assert covered.mean() == pytest.approx(np.pi * 40**2 / 100**2, rel=0.02)
    np.testing.assert_allclose(picture[100, 100], (0.0, 0.5, 1.0), atol=0.02)
    assert picture[100, 100, 2] > picture[100, 28, 2] > 0.45


@pytest.mark.parametrize("name", sorted(set(MAPS) - {"regions"}))
def test_light_does_not_change_what_a_colour_is_read_as(name: str) -> None:
    """The middle of a map, and values beside it, are read by the nearest colour of the map, on walls that are
    turned away by up to 60 degrees.
    """
    table = colour_table(name)
    surface = sphere(40.0, 60)
    for step in (64, 128, 192):
        canvas = Canvas(VIEW, 200, 200, WHITE)
        canvas.surface(surface, plain(tuple(table[step])))
        seen = canvas.pixels()[100, 100 - int(80 * np.sin(np.radians(60))) : 100] / 255
        read = np.linalg.norm(seen[:, None] - table[None], axis=2).argmin(axis=1)
        assert np.abs(read - step).max() <= 0.06 * 255


def test_nearer_things_hide_farther_ones() -> None:
    """In LPS the viewer of AP stands at -y."""
    canvas = Canvas(VIEW, 100, 100, WHITE)
    canvas.balls(np.array([[0.0, -30, 0]]), np.array([[1.0, 0, 0]]), 10.0)
    canvas.balls(np.array([[0.0, 30, 0]]), np.array([[0.0, 1, 0]]), 10.0)
    assert canvas.pixels()[50, 50].tolist() == [255, 0, 0]
    behind = Canvas(View(in_frame("LPS").looking(behind=True), np.zeros(3), 100.0), 100, 100, WHITE)
    behind.balls(np.array([[0.0, -30, 0], [0, 30, 0]]), np.array([[1.0, 0, 0], [0, 1, 0]]), 10.0)
    assert behind.pixels()[50, 50].tolist() == [0, 255, 0]


def test_balls_have_white_rims() -> None:
    """Pixels at the edges are mixed, about one in seven of those of the rim."""
    canvas = Canvas(VIEW, 800, 800, (0.0, 0.0, 0.0))
    canvas.balls(np.zeros((1, 3)), np.array([[1.0, 0, 0]]), 10.0)
    picture = canvas.pixels()
    white, red = (picture == 255).all(axis=2), (picture[..., 0] > 100) & (picture[..., 1] == 0)
    assert red.sum() == pytest.approx(8**2 * np.pi * 7.6**2, rel=0.1)
    assert white.sum() == pytest.approx(8**2 * np.pi * (10**2 - 7.6**2), rel=0.2)


@pytest.mark.parametrize(
    ("values", "wanted"),
    [
        ([0.0, 1.0, np.nan], "neither"),
        ([0.5, 1.1], "max"),
        ([-0.1, 0.5], "min"),
        ([-1.0, 2.0], "both"),
        ([], "neither"),
    ],
)
def test_colours_are_extended_where_values_lie_beyond(values: list[float], wanted: str) -> None:
    assert Field("key", "label", "mm", "sequential", 0.0, 1.0).extended(np.array(values)) == wanted


def test_bars_of_pictures_are_pointed_where_values_lie_beyond(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    subject = read_subject([finished(tmp_path / "run")])
    pointed = pictures_png(subject)
    for extended in ("max", "neither"):  # of the points; the scale fits the wall
        ends = {"points": extended}
        monkeypatch.setattr(Field, "extended", lambda self, values, ends=ends: ends.get(self.key, "neither"))
        assert (pictures_png(subject) == pointed) == (extended == "max")


@pytest.mark.parametrize("frame", ["LPS", "RAS"])
def test_left_is_on_the_right_and_up_is_up(frame: str) -> None:
    left = np.array([1.0 if frame == "LPS" else -1.0, 0, 0])
    axes = in_frame(frame).looking()
    np.testing.assert_allclose(axes @ left, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(axes @ [0, 0, 1], [0, 1, 0], atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)


def test_named_veins_give_about_the_patients_axes() -> None:
    """However the map is turned, and by whatever synonym a vein is called."""
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    veins = {
        "LSPV": (25, 20, 12),
        "left inferior PV": (26, 22, -10),
        "RUPV": (-24, 18, 10),
        "RIPV": (-25, 20, -9),
    }
    found = by_veins({name: turn @ at for name, at in veins.items()})
    assert found is not None
    known = in_frame("LPS")
    for name in ("left", "front", "up"):
        assert getattr(found, name) @ turn @ getattr(known, name) > np.cos(
            np.radians(8)
        )  # as aslant as these veins
    axes = found.looking()
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "veins",
    [
        {"LSPV": (25.0, 20, 12), "RSPV": (-24.0, 18, 10)},
        {"LSPV": (25.0, 0, 0), "LIPV": (5.0, 0, 1), "RSPV": (-24.0, 0, 0)},
        {"one": (25.0, 20, 12), "two": (26.0, 22, -10), "three": (-24.0, 18, 10)},
    ],
    ids=["no inferior vein", "all along a line", "names of nothing"],
)
def test_veins_that_do_not_tell_the_axes_give_none(veins: dict[str, tuple[float, float, float]]) -> None:
    assert by_veins({name: np.array(at) for name, at in veins.items()}) is None


def test_axes_come_from_the_points_then_the_prior_then_the_veins(tmp_path: Path) -> None:
    """The prior's frame is turned with its pose."""
    subject = read_subject([finished(tmp_path / "run")])
    assert orientation(subject).known_by == "frame of the points, LPS"
    turned, result = np.diag([-2.0, -2.0, 2.0, 1.0]), subject.last
    run = replace(
        result.run,
        case=replace(result.run.case, frame="unknown", prior_frame="RAS"),
        estimates={**result.run.estimates, result.key: replace(result.estimate, T_map_prior=turned)},
    )
    turned_subject = replace(subject, results={**subject.results, result.name: replace(result, run=run)})
    seen = orientation(turned_subject)
    assert seen.known_by.startswith("frame of the prior, RAS")
    np.testing.assert_allclose(seen.looking(), in_frame("LPS").looking(), atol=1e-12)
    nowhere = replace(run, case=replace(run.case, prior_frame="unknown"))
    last = replace(subject, results={**subject.results, result.name: replace(result, run=nowhere)})
    assert orientation(last).known_by.startswith("named veins")


def test_slice_of_a_sphere_is_its_circle() -> None:
    segments = slice_surface(sphere(20.0, 80), 1, 12.0)
    radius = np.linalg.norm(segments, axis=2)
    np.testing.assert_allclose(radius, 16.0, atol=0.05)
    assert np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum() == pytest.approx(
        2 * np.pi * 16, rel=0.01
    )


def test_labels_stay_labels_when_a_surface_is_decimated_for_display() -> None:
    surface = sphere(20.0, 30)
    region = np.where(surface.vertices[:, 0] > 0, 1.0, 32.0)
    small = decimated(replace(surface, fields={"region": region, "force": region}), 400, 300)
    assert len(small.faces) <= 300
    assert set(np.unique(small.fields["region"])) == {1.0, 32.0}
    assert len(np.unique(small.fields["force"])) > 2


def test_slice_beside_a_surface_is_empty() -> None:
    assert slice_surface(sphere(20.0), 0, 30.0).shape == (0, 2, 2)


def test_missing_values_are_grey_and_ends_are_clipped() -> None:
    field = Field("x", "x", "mm", "sequential", 0.0, 1.0)
    colours = colours_of(np.array([np.nan, -5.0, 0.0, 1.0, 9.0]), field)
    assert colours[0].tolist() == [0.72] * 3
    assert (colours[1] == colours[2]).all()
    assert (colours[3] == colours[4]).all()


def test_ranges_are_robust_and_symmetric_where_signed() -> None:
    values = np.concatenate([np.linspace(-1, 2, 1000), [500.0, np.nan]])
    low, high = robust_range(values, signed=True, from_zero=False)
    assert low == -high
    assert high < 3
    assert robust_range(values)[0] == 0.0
    assert robust_range(np.full(5, np.nan)) == (0.0, 1.0)
    assert robust_range(np.zeros(5)) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("most", "unit", "end"),
    [
        (0.3, "mm", 2.0),
        (2.0, "mm", 2.0),
        (2.1, "mm", 5.0),
        (6.0, "mm", 10.0),
        (30, "mm", 50),
        (0.3, "px", 0.5),
    ],
)
def test_scales_of_lengths_end_at_few_numbers_so_that_cases_compare(
    most: float, unit: str, end: float
) -> None:
    values = np.append(np.full(100, most), [500.0, np.nan])
    assert length_range(values, unit) == (0.0, pytest.approx(end))
    assert length_range(-values, unit, signed=True) == (pytest.approx(-end), pytest.approx(end))


def test_every_length_of_a_report_has_such_a_scale_which_all_its_pictures_share(tmp_path: Path) -> None:
    subject = read_subject([finished(tmp_path / "run", bulged_case(), folds=3)])
    lengths = [one for one in known_fields(list(subject.surfaces.values()), "mm") if one.unit == "mm"]
    assert len(lengths) >= 4
    for field in [*lengths, point_field(subject)]:
        assert field.high in (2.0, 5.0, 10.0, 20.0, 50.0), field
        assert field.low in (0.0, -field.high), field


@pytest.mark.parametrize(("noise", "end"), [(0.2, 5.0), (6.0, 20.0)])
def test_distances_of_wall_and_points_share_a_scale(tmp_path: Path, noise: float, end: float) -> None:
    """Their bars stand side by side: one length must not have two places."""
    subject = read_subject([finished(tmp_path / "run", bulged_case(noise=noise), folds=3)])
    ends = {one.key: one.high for one in shown_fields(subject)}
    assert ends["distance_to_truth_mm"] == ends["left_out_mm"] == point_field(subject).high == end
    alone = {one.key: one.high for one in known_fields(list(subject.surfaces.values()), "mm")}
    assert max(alone["distance_to_truth_mm"], alone["left_out_mm"], 5.0) <= end
    assert ends["sd_mm"] == alone["sd_mm"]  # which is no distance


def test_outliers_do_not_stretch_the_scale_of_the_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tenth of the points lies far off, and has a mark of its own."""
    case = bulged_case()
    xyz = case.points.xyz.copy()
    xyz[:10] *= 1.5
    subject = read_subject([finished(tmp_path / "run", replace(case, points=replace(case.points, xyz=xyz)))])
    assert point_field(subject).high == 20.0

    def doubted(run: Any, key: str) -> Any:
        return np.where(np.arange(len(run.points.xyz)) < 10, 0.02, 1.0)

    monkeypatch.setattr(fields, "beliefs", doubted)
    assert point_field(subject).high <= 5.0


@pytest.mark.parametrize("values", [np.zeros(5), np.full(5, 1e-9), np.full(5, np.nan), np.zeros(0)])
def test_a_signed_field_of_nothing_has_the_colour_of_zero(values: np.ndarray) -> None:
    """The middle of the colours, which is light and grey: no colour of any direction."""
    low, high = robust_range(values, signed=True, from_zero=False)
    assert (low, high) == (-1.0, 1.0)
    colours = colours_of(np.zeros(5), Field("x", "x", "mm", "signed", low, high))
    assert colours.min() > 0.9
    assert np.ptp(colours) < 0.05


def test_voltages_and_times_have_the_colours_that_labs_know() -> None:
    """Scar red, healthy wall purple, between 0.5 and 1.5 mV (unipolar 5 and 8) whatever was measured; early
    red, late purple, over what was measured.
    """
    surface = sphere()
    z = surface.vertices[:, 2]
    values = {"bipolar": z, "unipolar": 0.1 * z, "lat": 3 * z + 100, "force": z}
    fields = {field.key: field for field in known_fields([replace(surface, fields=values)], "mm")}
    assert [(fields[key].low, fields[key].high) for key in ("bipolar", "unipolar")] == [
        (0.5, 1.5),
        (5.0, 8.0),
    ]
    assert fields["lat"].low == pytest.approx(np.percentile(values["lat"], 3))
    assert [fields[key].step for key in ("lat", "bipolar", "force")] == [10.0, 0.0, 0.0]
    for key in ("bipolar", "unipolar", "lat"):
        field = fields[key]
        low, high = colours_of(np.array([field.low - 1, field.high + 1]), field)
        np.testing.assert_allclose(low, [1, 0, 0], atol=0.01)
        assert high[2] > high[0] > 0.5 > high[1]
        assert field.low_end == "red"


def test_maps_change_in_lightness_only_one_way() -> None:
    """What a colour-blind reader sees, or a grey print, still orders the values."""
    for name in ("sequential", "deviation", "electrical", "points"):
        light = colour_table(name) @ [0.2126, 0.7152, 0.0722]
        steps = np.diff(light[::8])
        assert (steps > -1e-3).all() or (steps < 1e-3).all()


def test_the_first_colour_is_never_how_far_the_prior_was_moved(tmp_path: Path) -> None:
    """Not without truth, points left out or a deviation either; a pose alone has no displacement at all."""
    subject = read_subject([finished(tmp_path / "run", replace(bulged_case(), truth=None))])
    icp, level_set = subject.surfaces.values()
    assert "displacement_mm" not in icp.fields
    assert "displacement_mm" in level_set.fields
    assert known_fields([icp, level_set], "mm")[0].key == "sd_mm"
    bare = replace(level_set, fields={k: v for k, v in level_set.fields.items() if k != "sd_mm"})
    assert known_fields([bare], "mm")[0].key == "distance_to_nearest_point_mm"


def test_distances_of_points_left_out_are_carried_to_the_wall(tmp_path: Path) -> None:
    """Between the least and the largest measured, as any mean; unknown far from every point."""
    subject = read_subject([finished(tmp_path / "run", replace(bulged_case(), truth=None), folds=3)])
    for name, surface in subject.surfaces.items():
        values = surface.fields["left_out_mm"]
        measured = subject.results[name].measured("cross_validated")[1]
        known = np.isfinite(values)
        assert known.any()
        assert measured.min() <= values[known].min() < values[known].max() <= measured.max()
    assert known_fields(list(subject.surfaces.values()), "mm")[0].key == "left_out_mm"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report([finished(tmp_path_factory.mktemp("slides") / "run")], pdf=True)


def test_slides_are_made_on_request_only(report: Path, tmp_path: Path) -> None:
    """By a pipeline and by the command: they take longer than the page."""
    written = [finished(tmp_path / f"{pdf}", writes=(Report(pdf=pdf),)) for pdf in (False, True)]
    assert [(run / "report.pdf").exists() for run in written] == [False, True]
    assert [(run / "figures").exists() for run in written] == [False, True]
    for options, asked in (([], False), (["--pdf"], True)):
        assert answer(["report", str(report.parent), "--out", str(tmp_path / "page.html"), *options]) == 0
        assert (tmp_path / "page.pdf").exists() is asked


def test_slides_are_written_whole(report: Path) -> None:
    figures = {path.name: path.read_bytes() for path in (report.parent / "figures").iterdir()}
    assert set(figures) == {"summary.png", "distances.png", "surfaces_ap.png", "surfaces_pa.png"}
    assert all(data[:8] == b"\x89PNG\r\n\x1a\n" for data in figures.values())
    assert figures["surfaces_ap.png"] != figures["surfaces_pa.png"]
    pdf = report.with_suffix(".pdf").read_bytes()
    assert pdf.startswith(b"%PDF-")
    assert len(re.findall(rb"/Type /Page\b", pdf)) == 1
    assert b"CreationDate" not in pdf


@pytest.mark.parametrize(
    ("make", "views"), [(finished, ["AP", "PA"]), (finished_2d, ["in the plane"])], ids=["3D", "2D"]
)
def test_every_picture_says_what_it_is(
    make: Callable[[Path], Path], views: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Case, view, day and version at its lower edge, and every colour with numbers and its unit."""
    drawn: list[Figure] = []

    def kept(figure: Figure, dpi: int = 130) -> bytes:
        drawn.append(figure)
        return png(figure, dpi)

    for module in (slides, figures):
        monkeypatch.setattr(module, "png", kept)
    subject = read_subject([make(tmp_path / "run")])
    slides.write_slides(subject, tmp_path / "figures", tmp_path / "report.pdf")
    told = made(subject)
    assert re.fullmatch(r"\d{4}-\d\d-\d\d · o3dls \d+\.\d+\S*", told)
    said = [figure.texts[-1].get_text() for figure in drawn]
    pictures = [f"{subject.case.name} · view {view} · {told}" for view in views]
    assert said == [f"{pictures[0]} · {slides.NOTICE}", f"{subject.case.name} · {told}", *pictures]
    for figure in (drawn[0], *drawn[2:]):
        bars = [axes for axes in figure.axes if axes.get_xlabel().startswith("distance of the points")]
        assert [axes.get_xlabel() for axes in bars] == [f"distance of the points, {subject.unit}"]
        assert all(len(axes.get_xticks()) >= 3 for axes in bars)


def test_the_pdf_says_what_the_page_says(report: Path) -> None:
    """The same verdict, and the same means of every estimate."""
    pdfium = pytest.importorskip("pypdfium2", reason="pypdfium2 is not installed: no PDF is read")
    said = pdfium.PdfDocument(report.with_suffix(".pdf"))[0].get_textpage().get_text_range()
    subject = read_subject([report.parent])
    assert verdict(subject) in " ".join(said.split())
    first = slides.MOST_COLUMNS - 1  # and the last column, what was fitted
    for name, cells in mean_table(subject)[1]:
        assert " ".join([name, *cells[:first], cells[-1]]) in said


def test_outlines_in_two_dimensions_have_names_and_one_frame(tmp_path: Path) -> None:
    subject = read_subject([finished_2d(tmp_path / "run")])
    with plain_figure(8, 4) as figure:
        slides._draw_surfaces(figure, subject, (0.02, 0.03, 0.96, 0.95))
        icp, level_set, _ = figure.axes
        for axes, name in ((icp, "icp"), (level_set, "level_set")):
            named = [text.get_text() for text in axes.get_legend().get_texts()]
            assert named == ["prior", "truth", name]
        assert icp.get_xlim() == level_set.get_xlim()


def test_equal_runs_give_equal_slides(report: Path, tmp_path: Path) -> None:
    again = write_report([report.parent], tmp_path / "report.html", pdf=True)
    assert again.with_suffix(".pdf").read_bytes() == report.with_suffix(".pdf").read_bytes()
    for path in (report.parent / "figures").iterdir():
        assert path.read_bytes() == (tmp_path / "figures" / path.name).read_bytes()


def test_reports_in_one_folder_keep_their_own_pictures(report: Path, tmp_path: Path) -> None:
    for name in ("report.html", "other.html"):
        write_report([report.parent], tmp_path / name, pdf=True)
    assert {path.name for path in tmp_path.iterdir()} == {
        "report.html",
        "report.pdf",
        "figures",
        "other.html",
        "other.pdf",
        "other_figures",
    }


def test_slides_of_two_dimensions(tmp_path: Path) -> None:
    report = write_report([finished_2d(tmp_path / "run")], pdf=True)
    assert {path.name for path in (report.parent / "figures").iterdir()} == {
        "summary.png",
        "distances.png",
        "outlines.png",
    }


def test_long_names_stay_in_their_place_and_keep_their_ends(tmp_path: Path) -> None:
    folders = [finished(tmp_path / f"{'W' * 40}_{k}") for k in range(2)]
    subject = read_subject(folders)
    with plain_figure(11.69, 8.27) as figure:
        slides._draw_table(figure, subject, (0.04, 0.05, 0.58, 0.22))
        figure.draw_without_rendering()
        cells = {at: cell.get_text() for at, cell in figure.axes[0].tables[0].get_celld().items()}
        last = max(row for row, _ in cells)
        for row in range(1, last + 1):
            assert cells[row, 0].get_window_extent().x1 < cells[row, 1].get_window_extent().x0
        assert cells[last, 0].get_text().endswith("1 · level_set")
        title = figure.text(0.04, 0.9, "W" * 80, fontsize=17)
        shrunk(title, 600.0)
        assert title.get_window_extent().width < 630  # letters have whole pixels


def test_remarks_keep_to_their_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slides, "remarks", lambda _: [Remark("far off", "amber"), Remark("few points")])
    subject = read_subject([finished(tmp_path / "run")])
    wide = {most: slides._write_remarks(subject, most).split("\n") for most in (1, 2, 9)}
    assert wide[1] == ["and more in the report"]
    assert len(wide[2]) == 2
    assert len(wide[9]) == 2


def test_letters_that_the_font_lacks_become_boxes(tmp_path: Path) -> None:
    assert drawable("ab 左 $x$ предсердие") == "ab □ $x$ предсердие"
    assert len(drawable("x" * 100)) == 32
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_report([finished(tmp_path / "run", bulged_case(NASTY + " $\\frac{"))], pdf=True)


def test_a_triangle_seen_edge_on_draws_nothing() -> None:
    canvas = Canvas(VIEW, 50, 50, WHITE)
    flat = Surface(np.array([[0.0, 0, 0], [0, 10, 0], [0, 0, 10]]), np.array([[0, 1, 2]]))
    canvas.surface(flat, plain((0.0, 0.0, 0.0)))
    assert (canvas.pixels() == 255).all()


def test_page_and_slides_share_the_pictures_of_a_view(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[str] = []
    draw = pictures._draw_picture

    def counted(subject: Subject, name: str, *rest: Any) -> Any:
        drawn.append(name)
        return draw(subject, name, *rest)

    monkeypatch.setattr(pictures, "_draw_picture", counted)
    write_report([finished(tmp_path / "run")], pdf=True)
    assert drawn == ["icp", "level_set"] * 2  # from the front and from behind


@pytest.mark.parametrize("kind", sorted(MAPS))
def test_colours_are_those_of_matplotlib(kind: str) -> None:
    name, first, last = MAPS[kind]
    theirs = colormaps[name](np.linspace(first, last, 256))[:, :3]
    # plasma is no polyline, and the circle of hues has rounded corners there
    step = abs(np.diff(theirs, axis=0)).max()  # theirs are read at 256 places, and these between them
    most = {"plasma": 0.025, "hsv": 0.08}.get(name, step + 1 / 255)
    assert abs(colour_table(kind) - theirs).max() < most


def test_a_page_needs_no_matplotlib(tmp_path: Path) -> None:
    """Its import would take a tenth of the time of a run."""
    finished(tmp_path / "run")
    code = "import sys; from o3dls.report.writer import write_report; write_report([sys.argv[1]])"
    done = f"{code}; assert 'matplotlib' not in sys.modules"
    subprocess.run([sys.executable, "-c", done, str(tmp_path / "run")], check=True)


def test_surfaces_with_the_faces_of_the_prior_are_decimated_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a prior of 500 000 faces the decimation of every estimate took half of the time of a run."""
    done: list[int] = []
    fewer = display.reduced

    def counted(surface: Surface, faces: int) -> Surface:
        done.append(faces)
        return fewer(surface, faces)

    monkeypatch.setattr(display, "reduced", counted)
    prior = fine_sphere(4000)
    moved = [prior.with_vertices(prior.vertices * [1.0, 1.0 + k / 5, 1.0] + [k, 0, 0]) for k in range(4)]
    some = [decimated(replace(one, fields={"y": one.vertices[:, 1]}), 1000, 800, like=prior) for one in moved]
    assert done == [800]
    for small, one in zip(some, moved, strict=True):
        assert len(small.faces) <= 800
        assert np.array_equal(small.faces, some[0].faces)
        assert distances(small.vertices, one).max() < 1e-9
        assert distances(one.vertices, small).max() < 0.5
        np.testing.assert_allclose(small.fields["y"], small.vertices[:, 1], atol=1e-9)
    other = Surface(prior.vertices, prior.faces[::-1])
    decimated(other, 1000, 800, like=prior)
    assert done == [800, 800]
