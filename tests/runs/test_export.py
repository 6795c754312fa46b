"""Export: what is written reads back, in the frame that was asked for, with a sidecar and without the
patient's name.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from o3dls.errors import InputError, PipelineError
from o3dls.io.matlab import openep
from o3dls.io.points import read_points
from o3dls.io.surfaces import read_surface, read_surface_file
from o3dls.runs.export.finished import export_run
from o3dls.runs.export.formats import file_name
from o3dls.runs.export.writer import Export
from o3dls.runs.folder import read_run
from tests.finished import bulged_case, finished, finished_2d


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    writes = (
        Export(format="carto_vtk", field="sd_mm", vmin=0.0, vmax=2.0),
        Export(estimate="icp", format="stl"),
    )
    return finished(tmp_path_factory.mktemp("export") / "run", bulged_case("Doe^Jane"), writes=writes)


def test_writers_leave_files_with_sidecars(run: Path) -> None:
    names = ("level_set.carto.vtk", "icp.stl")
    assert {path.name for path in (run / "export").iterdir()} == {*names, *(f"{name}.json" for name in names)}
    facts = json.loads((run / "export/level_set.carto.vtk.json").read_text())
    assert facts["scalar"] == {
        "field": "sd_mm",
        "values": [0.0, 2.0],
        "at": [0.0, 1.0],
        "missing_vertices": 0,
    }
    assert facts["frame"] == "LPS"
    assert facts["units"] == "mm"


def test_carto_dialect_is_anonymous_and_scaled(run: Path) -> None:
    text = (run / "export/level_set.carto.vtk").read_text(encoding="ascii")
    assert text.startswith(
        "# vtk DataFile Version 3.0\nPatientData Anon Anon 00000000\nASCII\nDATASET POLYDATA\n"
    )
    for path in (run / "export").iterdir():
        assert b"Doe" not in path.read_bytes()


@pytest.mark.parametrize(
    "format",
    ["ply", "stl", "obj", "off", "vtk", "vtp", "carto_vtk", "carto_mesh", "openep", "opencarp", "dif"],
)
def test_every_format_reads_back(run: Path, tmp_path: Path, format: str) -> None:
    path = export_run(run, tmp_path / file_name("surface", format), format=format)
    written = read_surface(path)
    known = read_surface(run / "estimates/level_set/surface.ply")
    assert written.area == pytest.approx(known.area, rel=1e-4)
    assert written.watertight


@pytest.mark.parametrize("spacing", [0.001, 1000.0])
def test_a_volume_that_holds_nothing_or_fills_the_memory_is_refused(
    run: Path, tmp_path: Path, spacing: float
) -> None:
    with pytest.raises(InputError, match="would be right"):
        export_run(run, tmp_path / "a.nrrd", format="mask_nrrd", spacing=spacing)
    assert not list(tmp_path.iterdir())


def test_dif_is_in_lps_whatever_the_frame_of_the_case(run: Path, tmp_path: Path) -> None:
    found = read_run(run)
    ras = replace(found, case=replace(found.case, frame="RAS"))
    for case, expected in ((found, 1.0), (ras, -1.0)):
        Export(format="dif").write(
            found.estimates[found.final].surface, case, found.final, tmp_path / "a.xml"
        )
        file = read_surface_file(tmp_path / "a.xml")
        turn = np.array([expected, expected, 1.0])
        np.testing.assert_allclose(
            file.surface.vertices, found.estimates[found.final].surface.vertices * turn, atol=1e-3
        )
        assert json.loads((tmp_path / "a.xml.json").read_text())["frame"] == "LPS"
    with pytest.raises(PipelineError, match="LPS by definition"):
        Export(format="dif", frame="RAS")


def test_other_frame_turns_the_surface(run: Path, tmp_path: Path) -> None:
    lps, ras = (
        read_surface(export_run(run, tmp_path / f"{frame}.ply", frame=frame)) for frame in ("LPS", "RAS")
    )
    np.testing.assert_allclose(ras.vertices, lps.vertices * [-1, -1, 1], atol=1e-9)
    assert ras.volume == pytest.approx(lps.volume)


def test_wrong_words_are_named(run: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no estimate 'levelset': did you mean 'level_set'"):
        export_run(run, tmp_path / "a.ply", estimate="levelset")
    with pytest.raises(InputError, match="no format 'vpt': did you mean 'vtp'"):
        export_run(run, tmp_path / "a.vpt", format="vpt")
    with pytest.raises(PipelineError, match="vmin and vmax must be given together"):
        Export(format="carto_vtk", vmin=1.0)
    with pytest.raises(PipelineError, match="belongs to the formats carto_vtk and dif"):
        Export(format="ply", field="sd_mm")
    with pytest.raises(PipelineError, match="limits of a field, and none is named"):
        Export(format="carto_vtk", vmin=0.0, vmax=1.0)
    with pytest.raises(InputError, match="no field 'sd'"):
        export_run(run, tmp_path / "a.vtk", format="carto_vtk", field="sd")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("format", "name", "right"),
    [
        ("ply", "a.pts", ".ply"),
        ("opencarp", "a.vtk", ".pts or .elem"),
        ("opencarp", "a", ".pts or .elem"),
        ("tfm", "pose.txt", ".tfm"),
        ("mask_nifti", "a.nrrd", ".nii or .nii.gz"),
        ("phi_nrrd", "a.nii", ".nrrd"),
    ],
)
def test_a_name_that_belongs_to_another_format_is_refused(
    run: Path, tmp_path: Path, format: str, name: str, right: str
) -> None:
    with pytest.raises(InputError, match=f"{name}: files of the format {format} end in {right}$"):
        export_run(run, tmp_path / name, format=format)
    assert not list(tmp_path.iterdir())


def test_the_sidecar_names_the_fields_that_the_file_has_room_for(run: Path, tmp_path: Path) -> None:
    has = {}
    for format in ("ply", "stl", "openep", "carto_mesh"):
        path = export_run(run, tmp_path / file_name("a", format), format=format)
        has[format] = set(json.loads(path.with_name(f"{path.name}.json").read_text())["fields"])
    assert has["ply"] == set(read_surface(run / "estimates/level_set/surface.ply").fields)
    assert not has["stl"]
    for format in ("openep", "carto_mesh"):  # they know electrical values only
        assert has[format] <= {"lat", "bipolar", "unipolar", "impedance", "force"}


@pytest.mark.parametrize("format", ["carto_vtk", "opencarp"])
def test_what_an_export_does_not_keep_is_said(
    run: Path, tmp_path: Path, format: str, caplog: pytest.LogCaptureFixture
) -> None:
    found = read_run(run)
    shell = found.estimates[found.final].surface
    lat = np.where(np.arange(len(shell.vertices)) < 5, np.nan, 1.0 * np.arange(len(shell.vertices)))
    path = tmp_path / file_name("a", format)
    field = {"field": "lat"} if format == "carto_vtk" else {}
    with caplog.at_level("INFO", "o3dls"):
        Export(format=format, **field).write(replace(shell, fields={"lat": lat}), found, found.final, path)
    said = f"{path.name}: 5 of {len(lat)} vertices have no 'lat': they are "
    assert [line for line in caplog.messages if line.startswith(said)]
    assert path.with_name(f"{path.name}.json").is_file()


def test_openep_holds_the_points_in_the_frame_of_the_surface(run: Path, tmp_path: Path) -> None:
    known = read_points(run / "points.csv")
    for frame, sign in (("LPS", 1.0), ("RAS", -1.0)):
        path = export_run(run, tmp_path / f"{frame}.mat", format="openep", frame=frame)
        found = openep.read_points(path, path.read_bytes())
        for kind in ("eam", "ablation"):
            np.testing.assert_allclose(found.of(kind).xyz, known.of(kind).xyz * [sign, sign, 1], atol=1e-12)
        facts = json.loads(path.with_name(f"{path.name}.json").read_text())
        assert facts["points"] == {kind: len(known.of(kind)) for kind in ("eam", "ablation")}
        assert "no electrograms" in facts["electrograms"]
    for name in {"bipolar", "lat"} & known.columns.keys():
        np.testing.assert_allclose(
            found.of("eam").columns[name], known.of("eam").columns[name], rtol=0, atol=0.005
        )


def test_dif_is_anonymous_and_small_enough(run: Path, tmp_path: Path) -> None:
    path = export_run(run, tmp_path / "a.xml", format="dif", field="sd_mm", faces=500)
    assert b"Doe" not in path.read_bytes()
    surface = read_surface(path)
    assert len(surface.faces) <= 500
    assert surface.watertight
    assert "sd_mm" in surface.fields
    facts = json.loads((tmp_path / "a.xml.json").read_text())
    assert (facts["scalar"]["field"], facts["triangles"], facts["frame"]) == (
        "sd_mm",
        len(surface.faces),
        "LPS",
    )


@pytest.mark.parametrize("format", ["phi_nrrd", "phi_nifti", "mask_nrrd", "mask_nifti"])
def test_volumes_hold_the_surface(run: Path, tmp_path: Path, format: str) -> None:
    from o3dls.io.images.registry import read_image

    path = export_run(
        run, tmp_path / ("a.nrrd" if "nrrd" in format else "a.nii.gz"), format=format, frame="RAS"
    )
    image = read_image(path, path.read_bytes())
    known = read_surface(run / "estimates/level_set/surface.ply")
    inside = image.values < 0 if format.startswith("phi") else image.values == 1
    assert inside.sum() * np.prod(image.spacing) == pytest.approx(known.volume, rel=0.05)
    index = np.argwhere(inside)[:, ::-1].mean(axis=0)
    # both in LPS
    np.testing.assert_allclose(
        image.affine[:3, :3] @ index + image.affine[:3, 3], known.vertices.mean(axis=0), atol=2.0
    )


def test_poses_move_the_prior_onto_the_map(run: Path, tmp_path: Path) -> None:
    from o3dls.io.transforms import read_transform

    expected = json.loads((run / "run.json").read_text())["estimates"]["level_set"]["T_map_prior"]
    for name in ("a.tfm", "a.txt"):
        matrix, space = read_transform(export_run(run, tmp_path / name, format=name[2:]))
        assert space == "LPS"
        np.testing.assert_allclose(matrix, expected, atol=1e-9)


def test_a_case_in_pixels_is_refused_for_formats_in_millimetres(tmp_path: Path) -> None:
    case = replace(bulged_case("pixels"), units="px")
    for format in ("carto_vtk", "dif", "opencarp", "tfm"):
        assert "is in mm by definition, and the case is in px" in str(Export(format=format).obstacle(case))
    assert Export(format="ply").obstacle(case) is None


def test_two_dimensions_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the case is 2D"):
        export_run(finished_2d(tmp_path / "run"))
