"""The page of the paper: every number from the file, the same again from the same file, and nothing
half-made.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from o3dls.errors import InputError
from o3dls.geometry.surface import Surface
from o3dls.paper import drawing, noise, related
from o3dls.paper.compute import shown
from o3dls.paper.experiment import DEVELOPMENT, SEEDS, Row, Scope
from o3dls.paper.page import EXPERIMENTS
from o3dls.paper.reconstruction import alpha_shape, minimal_surface, poisson, tangent_planes
from o3dls.paper.results import RESULTS, read_results
from o3dls.paper.segment import segmented, threshold
from o3dls.report.palette import LIGHT, colour_of
from tests.browser import Visit, chromium, violations


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One quick page for all tests."""
    return quick_page(tmp_path_factory.mktemp("paper") / "the page")


def quick_page(out: Path) -> Path:
    """A quick page by the command that is named where there is none, without third-party data."""
    with pytest.raises(InputError, match=r"no such file; `o3dls .*` makes it") as refusal:
        read_results(out)
    named = shlex.split(str(refusal.value).split("`")[1])[1:]
    # linear algebra of another kernel rounds otherwise
    kernel = {name: value for name, value in os.environ.items() if name.startswith("OPENBLAS_")}
    environment = {"PATH": "/usr/bin:/bin", "OMP_NUM_THREADS": "1", "HOME": str(out.parent), **kernel}
    command = [sys.executable, "-m", "o3dls", *named, "--quick"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == str(out / "index.html")
    assert "1 of " in done.stderr, "progress goes to stderr"
    return out


def test_axe_finds_nothing_wrong(page: Path) -> None:
    with chromium() as launch:
        browser = launch(webgl=False)
        for width in (1440, 390):
            for scheme in ("light", "dark"):
                visit = Visit(browser, page / "index.html", wait=False, width=width, color_scheme=scheme)
                assert violations(visit) == []
                visit.page.close()


def test_a_quick_page_has_every_section_and_says_what_is_left_out(page: Path) -> None:
    text = (page / "index.md").read_text(encoding="utf-8")
    for words in (
        "Star in the plane",
        "Jar",
        "Patient-like left atrium",
        "repair by repair",
        "headline",
        "Related systems",
        "What must hold",
    ):
        assert words in text
    assert "no folder real/lv_phases in O3DLS_DATA" in text
    assert "not for clinical use" in text
    figures = {line.split("(")[-1].rstrip(")") for line in text.splitlines() if line.startswith("![")}
    assert figures
    assert all((page / name).stat().st_size > 5000 for name in figures)


def test_the_page_begins_with_all_its_figures_and_each_leads_to_its_numbers(page: Path) -> None:
    text = (page / "index.html").read_text(encoding="utf-8")
    assert text.count("<figure>") > 5
    assert text.rindex("<figure>") < text.index("<table>")
    assert text.index("<figure>") < text.index("What must hold")
    markdown = (page / "index.md").read_text(encoding="utf-8")
    assert markdown.rindex("![") < markdown.index("| --- |")
    links = re.findall(r'Numbers: <a href="#([^"]+)">([^<]+)</a>', text)
    assert len(links) == text.count("<figure>")
    for anchor, name in links:
        assert f'<h2 id="{anchor}">{name}</h2>' in text
        assert f"[{unescape(name)}](#{anchor})" in markdown


def test_code_is_set_as_code_and_no_backtick_is_left(page: Path) -> None:
    text = (page / "index.html").read_text(encoding="utf-8")
    assert '<meta name="viewport" content="width=device-width' in text
    assert "`" not in text
    assert "<code>level_set</code>" in text
    assert "`level_set`" in (page / "index.md").read_text(encoding="utf-8")


def test_a_narrow_screen_shows_the_page_at_a_size_that_can_be_read(page: Path) -> None:
    """Nothing but a table or a picture goes beyond the screen, and those scroll by themselves."""
    with chromium() as launch:
        visit = Visit(launch(), page / "index.html", wait=False, width=390, height=844)
        assert visit.errors == []
        assert visit.page.evaluate("document.documentElement.scrollWidth") <= 390
        shares = visit.page.evaluate("[...document.images].map((one) => one.width / one.naturalWidth)")
        assert min(shares) >= 0.5  # letters of 9 pt at 130 dots to the inch: 8 pixels or more
        visit.page.close()


def test_axes_with_bars_begin_at_zero_and_one_level_has_room(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(drawing, "png", lambda figure: drawn.append(figure) or b"")
    values = {method: {6.0: np.array([3.0, 5.0])} for method in ("icp", "level_set")}
    drawing.curves({"fitted": values}, "noise, %", "mean distance, mm")
    (axes,) = drawn[0].axes
    assert axes.get_ylim()[0] == 0.0
    assert axes.get_xlim() == (5.0, 7.0)


def test_every_method_has_a_colour_of_the_palette() -> None:
    for colours in (drawing.COLOURS, related.COLOURS):
        methods = {name: colour for name, colour in colours.items() if name != "truth"}
        assert set(methods.values()) <= set(LIGHT)
    assert len(set(related.COLOURS.values())) == len(related.METHODS)
    assert related.COLOURS["level_set"] == drawing.COLOURS["level_set"] == colour_of("level_set")


def test_the_page_is_made_from_the_file_alone(page: Path, tmp_path: Path) -> None:
    again = tmp_path / "again"
    shutil.copytree(page, again)
    shown(again)
    assert (again / "index.md").read_bytes() == (page / "index.md").read_bytes()
    assert (again / "index.html").read_bytes() == (page / "index.html").read_bytes()
    whole = json.loads((again / RESULTS).read_text())
    for row in whole["rows"]:
        if row["experiment"] == "star":
            row["held_out"] += 1000.0
    (again / RESULTS).write_text(json.dumps(whole))
    shown(again)
    assert "100" in (again / "index.md").read_text().split("## Star in the plane")[1].split("## Jar")[0]


@pytest.mark.parametrize("experiment", ["star", "jar", "alpha", "related"])
def test_a_task_done_again_gives_the_same_but_for_times(page: Path, experiment: str) -> None:
    """Every number of the results file and every shape that a figure shows: of the experiments that take
    seconds, the others run the same stages.
    """
    results = read_results(page)
    known = results.of(experiment)
    tasks = [task for one in EXPERIMENTS for task in one.tasks(Scope(quick=True))]
    again = next(task for task in tasks if task.experiment == experiment)()
    rows = json.loads(json.dumps(again.rows))
    assert rows
    assert all(row["seconds"] > 0.0 for row in rows)
    assert [without_time(row) for row in rows] == [without_time(row) for row in known[: len(rows)]]
    for name, shape in again.shapes.items():
        at = f"{experiment}/{name}"
        if isinstance(shape, Surface):
            kept = results.shape(at)
            np.testing.assert_array_equal(kept.vertices, shape.vertices.astype(np.float32))
            np.testing.assert_array_equal(kept.faces, shape.faces)
        else:
            np.testing.assert_array_equal(results.array(at), shape.astype(np.float32))


def without_time(row: Row) -> Row:
    return {key: value for key, value in row.items() if key != "seconds"}


@pytest.mark.parametrize("percent", noise.LEVELS["star"])
def test_on_the_star_of_the_readme_the_default_pipeline_beats_its_icp(percent: float) -> None:
    from data_synth import star
    from o3dls.evaluation.distances import distances
    from o3dls.pipeline.file import default_pipeline

    case = star(7, percent=percent)
    estimates = replace(default_pipeline().allowed_by(case), folds=0).fit(case)
    for points in (case.points.xyz, case.truth.held_out):
        icp, ours = (distances(points, estimates[name].surface).mean() for name in ("icp", "level_set"))
        assert ours < 0.9 * icp


def test_the_full_scope_has_twenty_seeds_at_every_level() -> None:
    tasks = noise.tasks(Scope())
    assert len(tasks) == 20 * (3 + 4)
    assert len(set(SEEDS)) == 20


def test_nothing_was_chosen_on_the_seeds_of_the_page() -> None:
    assert not set(SEEDS) & set(DEVELOPMENT)
    decimals = (
        "8214808651328230664709384460955058223172535940812848111745028410270193852110555964462294895493038196"
    )
    assert "".join(f"{seed:05d}" for seed in SEEDS) == decimals


def test_a_folder_that_is_not_ours_is_not_replaced(tmp_path: Path) -> None:
    from o3dls.paper.compute import make

    (tmp_path / "letter.txt").write_text("keep me")
    with pytest.raises(InputError, match="so o3dls does not replace it"):
        make(tmp_path, quick=True, force=True)


@pytest.mark.parametrize("manifest", [True, False])
def test_a_page_with_a_file_that_is_not_ours_is_not_replaced(manifest: bool, tmp_path: Path) -> None:
    from o3dls.io.atomic import check_free
    from o3dls.io.manifest import write_manifest

    for name in ("paper_results.json", "index.html", "index.md", "figures/noise.png", "shapes/noise/a.npz"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    if manifest:
        write_manifest(tmp_path)
    check_free(tmp_path, True, "paper")
    (tmp_path / "figures/letter.txt").write_text("keep me")
    with pytest.raises(InputError, match=r"holds figures/letter\.txt, which o3dls did not write"):
        check_free(tmp_path, True, "paper")


def test_a_folder_without_results_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=RESULTS):
        shown(tmp_path)


def test_the_angiogram_gives_the_atrium_without_its_neighbours() -> None:
    from data_synth import patient as make_patient
    from o3dls.evaluation.distances import distances, sample

    patient = make_patient(31547)
    assert patient.scan.shape[0] == 45
    assert np.allclose(np.diag(patient.affine)[:3], (0.78125, 0.78125, 1.5))
    prior, mask = segmented(patient.scan, patient.affine, patient.inside)
    everything = patient.scan > threshold(patient.scan)
    assert mask.sum() < 0.8 * everything.sum(), "ventricle and aorta are gone"
    assert distances(sample(prior, 3000), patient.case.prior).mean() < 0.5, (
        "half of the smallest side of a voxel and some more"
    )
    assert prior.watertight


@pytest.mark.parametrize("system", [tangent_planes, minimal_surface, poisson, alpha_shape])
def test_systems_without_a_prior_find_a_sphere_from_many_points(system) -> None:  # type: ignore[no-untyped-def]
    from o3dls.evaluation.distances import sample

    rng = np.random.default_rng(60214)
    points = rng.normal(size=(2000, 3))
    # exactly on a sphere is degenerate
    points *= rng.normal(20.0, 0.1, (2000, 1)) / np.linalg.norm(points, axis=1, keepdims=True)
    radius = np.linalg.norm(sample(system(points), 2000), axis=1)
    assert abs(radius.mean() - 20.0) < 1.0
