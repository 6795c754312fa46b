"""`o3dls segments`: segments of a mesh and of a run, on the terminal, as JSON and as fields of a surface."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from o3dls import Deform, Pipeline, Surface, read_surface, write_surface
from o3dls.cli.commands import cli
from o3dls.evaluation.segments.division import SEGMENTS
from o3dls.evaluation.segments.sureness import segment_sureness
from o3dls.motion.wall.samples import SurfaceSamples
from tests.chamber import measured
from tests.evaluation.test_segments import atrium, divided, outward
from tests.finished import finished, finished_2d


def said(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["segments", *map(str, arguments)])


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mesh") / "atrium.ply"
    write_surface(path, atrium())
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    marks = divided()[0].landmarks()
    case = replace(measured(atrium(), np.diag([1.0, 1.05, 0.97, 1.0]), 80, noise=1.0), frame="LPS")
    run = Pipeline([Deform()], folds=0).run(replace(case, prior_landmarks=marks))
    return run.write(tmp_path_factory.mktemp("runs") / "run")


def test_a_mesh_is_divided_without_landmarks(mesh: Path, tmp_path: Path) -> None:
    out = tmp_path / "divided.vtp"
    done = said(mesh, "--frame", "LPS", "--out", out, "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    written = read_surface(out)
    assert [row["segment"] for row in found["segments"]] == list(SEGMENTS)[1:]
    area = written.vertex_areas / 100.0
    for row in found["segments"]:
        own = area[written.fields["segment"] == row["segment"]].sum()
        assert row["area_cm2"] == pytest.approx(own, rel=1e-4)
        assert row["sure_percent"] is None
    assert sum(row["share_percent"] for row in found["segments"]) == pytest.approx(100.0)
    assert {"LSPV", "LAA", "MA", "A", "I"} <= found["places"].keys()
    assert {"alpha", "beta", "sheet"} <= written.fields.keys()
    text = said(mesh, "--frame", "LPS").stdout
    assert all(name in text for name in list(SEGMENTS.values())[1:])
    assert "not for a patient's record" in text


def test_landmarks_of_a_file_name_the_veins(mesh: Path, tmp_path: Path) -> None:
    marks = tmp_path / "marks.csv"
    at = divided()[0].landmarks()["LIPV"]
    marks.write_text("name,x,y,z\nLSPV," + ",".join(map(str, at)) + "\n", encoding="utf-8")
    places = json.loads(said(mesh, "--frame", "LPS", "--landmarks", marks, "--json").stdout)["places"]
    assert np.linalg.norm(places["LSPV"] - at) < 1.0


def test_openings_of_a_mesh_are_closed(tmp_path: Path) -> None:
    whole = atrium()
    kept = (whole.vertices @ outward("MA"))[whole.faces].max(axis=1) < 16.5
    path = tmp_path / "open.ply"
    write_surface(path, Surface(whole.vertices, whole.faces[kept]).without_unused())
    done = said(path, "--frame", "LPS", "--json")
    assert done.exit_code == 0, done.output
    assert len(json.loads(done.stdout)["segments"]) == 8


def test_segments_of_a_run_say_how_sure_they_are(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "divided.vtp"
    done = said(folder, "--samples", 8, "--json", "--out", out)
    assert done.exit_code == 0, done.output
    assert all(50.0 < row["sure_percent"] < 100.0 for row in json.loads(done.stdout)["segments"])
    sure, segment = (read_surface(out).fields[name] for name in ("segment_sure", "segment"))
    faces = read_surface(out).faces
    border = np.unique(faces[(segment[faces] != segment[faces][:, :1]).any(axis=1)])
    assert sure[border].mean() < np.delete(sure, border).mean()
    assert said(folder, "--samples", 8).stdout == said(folder, "--samples", 8).stdout


def test_a_run_without_a_posterior_has_segments_alone(tmp_path: Path) -> None:
    done = said(finished(tmp_path / "run"), "--json")
    assert done.exit_code == 0, done.output
    assert {row["sure_percent"] for row in json.loads(done.stdout)["segments"]} == {None}


def test_a_place_is_as_sure_as_samples_have_its_segment_there() -> None:
    surface = atrium()
    segment = divided()[1].segment
    far = surface.vertices + np.array([30.0, 0.0, 0.0])
    samples = SurfaceSamples(surface, np.stack([surface.vertices, far]), np.ones((2, len(far)), bool))
    sure = segment_sureness(samples, segment)
    assert sure.min() == 0.5  # there in the sample that did not move
    assert (segment_sureness(SurfaceSamples(surface, far[None], samples.exists[:1]), segment) < 1.0).any()


def test_what_cannot_be_divided_is_refused(folder: Path, mesh: Path, tmp_path: Path) -> None:
    refused = {
        (finished_2d(tmp_path / "flat"),): "must be in 3D and mm",
        (folder, "--frame", "LPS"): "is a run, which has landmarks and a frame of its own",
        (folder, "--out", folder / "estimates" / "x.vtp"): "belongs to the run",
        (mesh, "--out", tmp_path / "x.foo"): "cannot write surfaces as '.foo'",
    }
    for arguments, why in refused.items():
        done = said(*arguments)
        assert done.exit_code != 0
        assert why in str(done.exception)


def test_areas_of_segments_are_measured_with_their_intervals(folder: Path) -> None:
    done = CliRunner().invoke(cli, ["measure", str(folder), "--by", "segments", "--samples", "30", "--json"])
    assert done.exit_code == 0, done.output
    areas = {one["where"]: one for one in json.loads(done.stdout)["measures"] if one["what"] == "area"}
    assert set(areas) == {"wall", *list(SEGMENTS.values())[1:]}
    parts = sum(one["naive"] for where, one in areas.items() if where != "wall")
    assert parts == pytest.approx(areas["wall"]["naive"])  # a face counts to each by its corners there
    table = json.loads(said(folder, "--json").stdout)["segments"]
    for row in table:
        own = areas[row["name"]]
        assert own["low"] < own["naive"] < own["high"]
        assert own["naive"] == pytest.approx(row["area_cm2"], rel=1e-3)
