"""Contours on the image: they lie on the walls that the image shows, wherever its voxels lie and whichever
frame it is in; what is drawn, where slices lie, and how much of it the page can carry.
"""

from __future__ import annotations

import base64
import csv
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import map_coordinates

from data_synth.segmentation import solid
from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.cli.main import answer
from o3dls.geometry.similarity import TURN, apply
from o3dls.io.case_reader import read_case
from o3dls.io.case_writer import write_case
from o3dls.report.drawing.slices import write_path
from o3dls.report.page_parts import asset
from o3dls.report.stacks.brought import Brought, brought_back
from o3dls.report.stacks.pictures import LINES
from o3dls.report.stacks.section import image_section
from o3dls.report.stacks.stack import BESIDE, COUNT, ORDER, Stacks, make_stacks
from o3dls.report.subject import Subject, read_subject
from o3dls.report.writer import write_report
from tests.browser import Visit, chromium, violations
from tests.finished import bulged_case, finished
from tests.oblique import SHAPE, SPACING, places, write

HALF_VOXEL = SPACING.min() / 2  # mm
BLOB = np.array([14.0, 0.0, 0.0])  # mm, to the patient's left of the middle, in LPS
MORE = 1_500_000  # bytes that the image may add to a page


def distance_image() -> Array:
    """Signed distance (ni, nj, nk) to the prior of the bulged case, in micrometres."""
    return np.asarray(1000.0 * solid(bulged_case().prior)(places().reshape(-1, 3)).reshape(SHAPE))


def turned(case: Case) -> Case:
    """The case in RAS."""
    points = replace(case.points, xyz=apply(TURN, case.points.xyz))
    marks = {name: apply(TURN, at) for name, at in case.prior_landmarks.items()}
    truth = None
    prior = case.prior.transformed(TURN)
    return replace(
        case, prior=prior, points=points, prior_landmarks=marks, truth=truth, frame="RAS", prior_frame="RAS"
    )


def run_with(folder: Path, values: Array, name: str = "lps.nrrd", frame: str = "LPS") -> Path:
    """A finished run of the bulged case, in a frame, whose image has these values."""
    case = replace(bulged_case(), prior_frame="LPS")
    write_case(folder / "case", turned(case) if frame == "RAS" else case)
    write(folder, name, values)
    toml = folder / "case" / "case.toml"
    toml.write_text(toml.read_text() + f'image = "../{name}"\n')
    return finished(folder / "run", read_case(folder / "case"))


def subject_of(run: Path) -> Subject:
    return read_subject([run])


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_with(tmp_path_factory.mktemp("stacks"), distance_image())


@pytest.fixture(scope="module")
def brought(run: Path) -> Brought:
    return brought_back(subject_of(run))


@pytest.fixture(scope="module")
def stacks(brought: Brought) -> Stacks:
    return make_stacks(brought)


def html_of(run: Path) -> str:
    section = image_section(subject_of(run))
    assert section is not None
    return section.html()


def cuts_of(html: str) -> list[str]:
    return re.findall(r'<g class="cut".*?</g>', html)


def number(text: str, name: str) -> float:
    found = re.search(rf'\b{name}="([-\d.e]+)"', text)
    assert found is not None
    return float(found[1])


def grey_at(cut: str, html: str, places: Array) -> Array:
    """Values of the image, as the page shows it, at places (n, 2) of the drawing."""
    data = re.search(r"base64,([^\"]+)", cut)
    assert data is not None
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(data[1]))), dtype=float)
    left, top, width, height = (number(cut, name) for name in ("x", "y", "width", "height"))
    column = (places[:, 0] - left) / width * pixels.shape[1] - 0.5
    row = (places[:, 1] - top) / height * pixels.shape[0] - 0.5
    shares = map_coordinates(pixels, [row, column], order=1) / 255.0
    low, high = number(html, "data-low"), number(html, "data-high")
    return np.asarray(low + shares * (high - low))


def line_of(cut: str, key: str) -> Array:
    """Corners (n, 2) of a contour in the drawing."""
    path = re.search(rf'<path d="([^"]*)" class="line {key}">', cut)
    assert path is not None
    return np.array([[float(x), float(y)] for x, y in re.findall(r"([-\d.]+) ([-\d.]+)", path[1])])


@pytest.mark.parametrize(
    ("name", "frame"),
    [
        ("lps.nrrd", "LPS"),
        ("ras.nrrd", "RAS"),
        ("image.nii.gz", "RAS"),
        ("a.mha", "LPS"),
        ("ras.nrrd", "LPS"),
    ],
)
def test_contours_lie_on_the_walls_that_the_page_shows(name: str, frame: str, tmp_path: Path) -> None:
    html = html_of(run_with(tmp_path, distance_image(), name, frame))
    cuts = cuts_of(html)
    assert len(cuts) == 3 * COUNT
    lines = [(cut, line_of(cut, "prior")) for cut in cuts if 'class="line prior"' in cut]
    assert len(lines) >= 3 * COUNT - 2  # a slice through the tip of the bulge meets the result alone
    off = np.concatenate([grey_at(cut, html, line) / 1000.0 for cut, line in lines])
    assert len(off) > len(lines) * 10
    assert np.abs(off).max() < HALF_VOXEL
    assert abs(off.mean()) < 0.1


@pytest.mark.parametrize("frame", ["LPS", "RAS"])
def test_the_patients_left_is_where_the_page_says(frame: str, tmp_path: Path) -> None:
    spot = 1000.0 * np.exp(-((np.linalg.norm(places() - BLOB, axis=-1) / 6.0) ** 2))
    brought = brought_back(subject_of(run_with(tmp_path, spot, "image.nii", frame)))
    for stack in make_stacks(brought).stacks:
        brightest = max(stack.cuts, key=lambda cut: int(cut.pixels.max()))
        row, column = np.unravel_index(brightest.pixels.argmax(), brightest.pixels.shape)
        assert stack.frame.sides is not None
        if "left" in stack.frame.sides[1]:
            assert column > 0.6 * brightest.pixels.shape[1]
            assert 0.3 < row / brightest.pixels.shape[0] < 0.7
        else:  # sagittal: the slice itself lies on the left
            assert stack.plane == "sagittal"
            assert abs(stack.place(brightest) - (14.0 if frame == "LPS" else -14.0)) < 4.0


def test_slices_lie_closer_where_the_result_differs_and_where_points_are(
    stacks: Stacks, brought: Brought
) -> None:
    (sagittal,) = (stack for stack in stacks.stacks if stack.plane == "sagittal")
    places = np.array([sagittal.place(cut) for cut in sagittal.cuts])
    assert (np.diff(places) > 0).all()
    assert (places > 5.0).sum() > (places < -5.0).sum()  # the ball bulges towards +x
    everywhere = replace(brought, points=np.tile([[0.0, 0.0, 12.0]], (500, 1)))
    (axial,) = (stack for stack in make_stacks(everywhere).stacks if stack.plane == "axial")
    assert sum(abs(axial.place(cut) - 12.0) < 2.0 for cut in axial.cuts) >= 4  # a third of the twelve


def test_every_slice_meets_a_wall_and_has_the_points_beside_it(stacks: Stacks, brought: Brought) -> None:
    assert [stack.plane for stack in stacks.stacks] == list(ORDER)
    for stack in stacks.stacks:
        for cut in stack.cuts:
            assert len(cut.outlines["prior"]) or len(cut.outlines["similar"])
            beside = np.abs(brought.points @ stack.axes[2] - cut.level) < BESIDE
            assert len(cut.points) == beside.sum()
            plural = "" if beside.sum() == 1 else "s"
            assert stack.name(cut).endswith(f"{beside.sum()} point{plural} within 2 mm")


def test_the_motion_brings_back_what_it_moved(brought: Brought) -> None:
    layers = {layer.key: layer.surface for layer in brought.layers}
    assert list(layers) == ["prior", "baseline", "similar", "moved"]
    assert layers["moved"].vertices == pytest.approx(layers["prior"].vertices, abs=1e-3)
    apart = np.linalg.norm(layers["similar"].vertices - layers["prior"].vertices, axis=1)
    assert apart.max() == pytest.approx(3.0, abs=0.2)  # the bulge, which the similarity leaves
    steps = layers["baseline"].vertices - layers["prior"].vertices
    assert steps == pytest.approx(np.full_like(steps, 0.3), abs=1e-6)  # where the ICP put the prior


def test_without_an_image_the_page_knows_nothing_of_it(tmp_path: Path) -> None:
    run = finished(tmp_path / "run")
    page = write_report([run]).read_text(encoding="utf-8")
    assert image_section(subject_of(run)) is None
    assert "stacks" not in page
    assert "grey-window" not in page


def test_a_label_volume_is_drawn_where_there_is_no_image(tmp_path: Path) -> None:
    (tmp_path / "case").mkdir()
    write(tmp_path / "case", "prior.nrrd", (distance_image() < 0).astype(np.uint8))
    write_case(tmp_path / "points", bulged_case())
    (tmp_path / "points" / "points.csv").rename(tmp_path / "case" / "points.csv")
    html = html_of(finished(tmp_path / "run", read_case(tmp_path / "case")))
    assert "The label volume of the prior, prior.nrrd" in html
    cut = cuts_of(html)[COUNT // 2]
    middle = line_of(cut, "prior").mean(axis=0, keepdims=True)
    assert grey_at(cut, html, middle) == pytest.approx(1.0, abs=0.05)
    assert number(html, "data-low") == 0.0


def test_noise_is_packed_into_what_a_page_may_have(tmp_path: Path) -> None:
    rng = np.random.default_rng(61_380)
    noisy = run_with(tmp_path, rng.normal(size=SHAPE))
    plain = write_report([noisy], tmp_path / "plain.html").stat().st_size - len(html_of(noisy))
    assert len(html_of(noisy)) + 6_000 < MORE
    assert plain + MORE < 5_500_000


def test_what_is_left_out_of_a_line_stands_off_it_by_less_than_the_tolerance() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 241)
    ring = 100.0 + 80.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    segments = np.stack([ring[:-1], ring[1:]], axis=1)
    whole, thin = write_path(segments), write_path(segments, 0.1)
    assert len(thin) < len(whole) / 2.5
    kept = np.array([place.split() for place in thin[1:].split("L")], dtype=float)
    middles = (kept[1:] + kept[:-1]) / 2
    assert np.abs(np.linalg.norm(middles - 100.0, axis=1) - 80.0).max() < 0.1 + 0.08  # written to a tenth
    assert kept[0] == pytest.approx(kept[-1])


def test_an_image_that_is_gone_is_said_and_another_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = run_with(tmp_path, distance_image())
    (tmp_path / "lps.nrrd").rename(tmp_path / "moved.nrrd")
    said = html_of(run)
    assert re.search(r"No contours on the image: the image is no longer at \S+lps.nrrd", said)
    assert "With o3dls slices RUN --image FILE they are drawn anyway" in said
    assert answer(["slices", str(run)]) == 2
    said = capsys.readouterr().err.strip()
    assert re.search(r"the image is no longer at \S+lps.nrrd; name where it is by --image$", said)
    assert answer(["slices", str(run), "--image", str(tmp_path / "moved.nrrd")]) == 0
    assert len(list((run / "slices").glob("*.png"))) == 3 * COUNT


def test_slices_are_written_as_pictures_with_a_table(
    run: Path, stacks: Stacks, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answer(["slices", str(run), "--out", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / "out")
    with (tmp_path / "out" / "slices.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["file"] for row in rows[:2]] == ["axial_01.png", "axial_02.png"]
    assert [float(row["place_mm"]) for row in rows[:COUNT]] == pytest.approx(
        [stacks.stacks[0].place(cut) for cut in stacks.stacks[0].cuts]
    )
    blue = np.array([int(LINES["moved"][0][k : k + 2], 16) for k in (1, 3, 5)])
    seen = []
    for row in rows:
        pixels = np.asarray(Image.open(tmp_path / "out" / row["file"]).convert("RGB"))
        assert pixels.shape[1] == 800
        seen.append((np.abs(pixels.astype(int) - blue).max(axis=-1) < 12).sum())
    assert (np.array(seen) > 200).mean() > 0.9  # the contour is there, but in the tip of the bulge


@pytest.mark.parametrize("key", LINES)
def test_pictures_have_the_colours_of_the_page(key: str) -> None:
    assert f".stacks .line.{key} {{ stroke: {LINES[key][0]};" in asset("stacks.css")


def test_a_run_without_an_image_asks_for_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = write(tmp_path, "other.nrrd", distance_image())
    run = finished(tmp_path / "run", replace(bulged_case(), prior_frame="LPS"))
    assert answer(["slices", str(run)]) == 2
    assert "has no image of its prior; name one with --image" in capsys.readouterr().err
    assert answer(["slices", str(run), "--image", str(image)]) == 0
    unknown = finished(tmp_path / "unknown")
    assert answer(["slices", str(unknown), "--image", str(image)]) == 2
    assert "the frame of the prior is not known" in capsys.readouterr().err


@pytest.fixture(scope="module")
def launch() -> Iterator[Callable[..., Any]]:
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def page(run: Path) -> Path:
    return write_report([run])


@pytest.mark.parametrize("width", [1440, 390])
def test_the_page_moves_through_the_slices(launch: Callable[..., Any], page: Path, width: int) -> None:
    visit = Visit(launch(), page, width=width)
    whole = visit.page.locator("#image")
    axial = whole.locator(".stack").first
    shown = axial.locator("g.cut:not([display])")
    assert shown.count() == 1
    axial.locator("input").fill("3")
    assert shown.count() == 1
    assert axial.locator("output").text_content() == f"3 of 12: {shown.get_attribute('data-said')}"
    whole.locator("[data-layer=moved]").uncheck()
    assert not shown.locator(".moved").is_visible()
    assert shown.locator(".prior").is_visible()
    before = float(whole.locator("feFuncG").get_attribute("slope"))
    ends = whole.locator("[data-grey=window]")
    ends.fill(str(float(ends.get_attribute("max")) / 4))
    assert float(whole.locator("feFuncG").get_attribute("slope")) == pytest.approx(4.0, rel=0.02)
    assert before < 4.0
    assert visit.page.evaluate("document.documentElement.scrollWidth") <= width
    assert visit.errors == []
    assert visit.requests == [page.resolve().as_uri()]
    found = [one for one in violations(visit) if "#image" in one or "stack" in one or "grey" in one]
    assert found == []
    visit.page.close()


def test_the_window_makes_grey_values_black_and_white(launch: Callable[..., Any], page: Path) -> None:
    """What the browser paints at the middle of the ball, for two levels."""
    visit = Visit(launch(), page)
    axial = visit.page.locator("#image .stack svg.slice").first
    axial.scroll_into_view_if_needed()
    level = visit.page.locator("[data-grey=level]")
    painted = []
    for end in ("min", "max"):
        level.fill(level.get_attribute(end))
        visit.settle()
        pixels = np.asarray(Image.open(io.BytesIO(axial.screenshot())).convert("L"), dtype=float)
        rows, columns = (slice(int(0.4 * n), int(0.6 * n)) for n in pixels.shape)
        painted.append(np.median(pixels[rows, columns]))
    assert painted[0] > painted[1] + 60
    visit.page.close()
