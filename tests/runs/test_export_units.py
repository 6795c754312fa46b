"""What is exported on the prior is in the units of the prior's own file, and says so."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from o3dls.case import MILLIMETRES
from o3dls.errors import InputError
from o3dls.io.case_reader import read_case
from o3dls.io.case_settings import toml_lines
from o3dls.io.case_writer import write_case
from o3dls.io.images.registry import read_image
from o3dls.io.points import read_points, read_points_table, write_points
from o3dls.io.surfaces import read_surface_file, write_surface
from o3dls.io.table import write_table
from o3dls.io.transforms import read_transform
from o3dls.pipeline.pipeline import Pipeline
from o3dls.runs.export.finished import export_run
from tests.runs.test_export_on_prior import Known, turned_case

CASE = turned_case("LPS", "LPS")


def run_of(folder: Path, units: str, *, stated: bool) -> Path:
    """A run on a prior whose file is in `units`, as the file or else the case says; the points are in mm."""
    write_case(folder / "case", CASE)
    (folder / "case" / "case.toml").write_text(
        toml_lines({"frame": "LPS"} if stated else {"frame": "LPS", "units": units})
    )
    write_points(folder / "case" / "points.csv", CASE.points, units="mm")
    prior = CASE.prior.with_vertices(CASE.prior.vertices / MILLIMETRES[units])
    write_surface(folder / "case" / "prior.ply", prior, space="LPS", units=units if stated else "unknown")
    marks = np.array(list(CASE.prior_landmarks.values()))
    columns = {"name": np.array(list(CASE.prior_landmarks)), **dict(zip("xyz", marks.T, strict=True))}
    write_table(folder / "case" / "prior_landmarks.csv", columns, {"units": "mm"})
    return Pipeline([Known()], folds=0).run(read_case(folder / "case")).write(folder / "run")


@pytest.mark.parametrize(("units", "stated"), [("m", True), ("cm", False), ("mm", True)])
@pytest.mark.parametrize("format", ["ply", "vtp", "stl", "obj"])
def test_a_surface_lies_on_the_file_that_was_given(
    tmp_path: Path, units: str, stated: bool, format: str
) -> None:
    given = CASE.prior.vertices / MILLIMETRES[units]
    out = export_run(
        run_of(tmp_path, units, stated=stated), tmp_path / f"a.{format}", format=format, on="prior"
    )
    found = read_surface_file(out)
    # STL has single precision and its own order of vertices
    np.testing.assert_allclose(np.ptp(found.surface.vertices, axis=0), np.ptp(given, axis=0), rtol=1e-5)
    if format in ("ply", "vtp"):
        assert (found.units, found.space) == (units, "LPS")
        np.testing.assert_allclose(found.surface.vertices, given, rtol=1e-12, atol=1e-12)
        assert found.surface.fields["distance_to_result_mm"].max() < 1e-6  # its name says its unit
    facts = json.loads(out.with_name(out.name + ".json").read_text())
    assert (facts["units"], facts["prior_file_units"], facts["T_map_prior_units"]) == (units, units, "mm")


def test_another_reader_finds_the_surface_where_its_own_prior_is(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    run = run_of(tmp_path, "cm", stated=False)
    out = export_run(run, tmp_path / "a.stl", format="stl", on="prior")
    prior, found = (trimesh.load(path) for path in (tmp_path / "case" / "prior.ply", out))
    np.testing.assert_allclose(found.bounds, prior.bounds, rtol=1e-5)  # single precision
    assert found.volume == pytest.approx(prior.volume, rel=1e-4)


def test_points_on_the_prior_are_in_its_units_too(tmp_path: Path) -> None:
    run = run_of(tmp_path, "m", stated=True)
    out = export_run(run, tmp_path / "a.csv", format="csv", on="prior")
    assert read_points_table(out, 3).notes["units"] == "m"
    found, mm = read_points(out, 3), CASE.prior.vertices
    assert (np.abs(found.xyz * 1000.0 - mm.mean(axis=0)).max(axis=0) < np.ptp(mm, axis=0)).all()
    on_map = export_run(run, tmp_path / "b.csv", format="csv")
    assert read_points_table(on_map, 3).notes["units"] == "mm"
    np.testing.assert_allclose(read_points(on_map, 3).xyz, CASE.points.xyz, atol=1e-9)


def test_what_is_in_millimetres_by_definition_stays_and_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "o3dls")
    runs = [run_of(tmp_path / units, units, stated=True) for units in ("cm", "mm")]
    poses = [export_run(run, run.parent / "a.tfm", format="tfm", on="prior") for run in runs]
    np.testing.assert_allclose(*(read_transform(path)[0] for path in poses), atol=1e-9)
    assert "a.tfm: is in mm, as every tfm is; the prior's own file is in cm" in caplog.messages
    masks = [
        export_run(run, run.parent / "a.nrrd", format="mask_nrrd", on="prior", spacing=2.0) for run in runs
    ]
    images = [read_image(path, path.read_bytes()) for path in masks]
    np.testing.assert_allclose(images[0].affine, images[1].affine, atol=1e-9)
    for path in (poses[0], masks[0]):
        facts = json.loads(path.with_name(path.name + ".json").read_text())
        assert (facts["units"], facts["prior_file_units"]) == ("mm", "cm")
    assert sum("the prior's own file" in said for said in caplog.messages) == 2


def test_opencarp_says_its_micrometres(tmp_path: Path) -> None:
    out = export_run(run_of(tmp_path, "cm", stated=True), tmp_path / "a.pts", format="opencarp", on="prior")
    assert json.loads(out.with_name(out.name + ".json").read_text())["units"] == "um"
    extent = np.ptp(np.loadtxt(out, skiprows=1), axis=0)
    np.testing.assert_allclose(extent, np.ptp(CASE.prior.vertices, axis=0) * 1000.0, rtol=1e-4)


def test_a_case_takes_no_other_units_for_the_file_of_its_prior() -> None:
    with pytest.raises(InputError, match="prior_file_units = 'inch': must be one of mm, cm, m, um, in"):
        replace(CASE, prior_file_units="inch")
    with pytest.raises(InputError, match="prior_file_units = 'px'"):
        replace(CASE, prior_file_units="px")
