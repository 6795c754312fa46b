"""The run folder: complete, read back equal, equal for equal runs, and whole or not at all."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from tiny import Broken, Greedy, Nudge, ball_case, disc_case, tiny_stages  # noqa: F401  (a fixture)

from o3dls.case import Case
from o3dls.errors import InputError, SolverError
from o3dls.estimate import Estimate
from o3dls.io.points import read_points
from o3dls.io.surfaces import read_surface
from o3dls.pipeline.file import pipeline_from
from o3dls.pipeline.pipeline import Pipeline
from o3dls.plugins.stage import Stage
from o3dls.report.writer import compare, write_report
from o3dls.run_warning import RunWarning
from o3dls.runs.export.finished import export_run
from o3dls.runs.folder import read_run
from o3dls.runs.log import log_of_failure
from o3dls.runs.run import Run, record
from o3dls.runs.writers import Writer
from o3dls.stages.deform import Deform

POINT_SET = {"n", "mean_mm", "median_mm", "rms_mm", "p95_mm", "max_mm"}
ALL_SETS = {
    "fitted",
    "held_out",
    "held_out_seen",
    "held_out_unseen",
    "ablation",
    "landmarks",
    "cross_validated",
    "correspondence",
    "truth_to_surface",
    "surface_to_truth",
    "truth",
}


class Note(Writer):
    """Leaves a file, or fails half way."""

    name: ClassVar[str] = "note"
    fail: bool = False

    def __call__(self, run: Any, folder: Path) -> None:
        (folder / "note.txt").write_text(run.final)
        if self.fail:
            raise SolverError("the note cannot be finished")


class Stuck(Stage):
    """Never ends."""

    name: ClassVar[str] = "stuck"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        raise SolverError("no step lowers the energy")


def without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: without_times(item) for key, item in value.items() if key != "seconds"}
    return value


def test_run_json_holds_what_the_contract_names(tmp_path: Path) -> None:
    folder = Pipeline([Nudge()]).run(replace(ball_case(), files={"prior.ply": "ab"})).write(tmp_path / "run")
    found = json.loads((folder / "run.json").read_text())
    assert found["schema"] == "o3dls/run/2"
    assert found["case"]["name"] == "ball"
    assert found["case"]["files"] == {"prior.ply": "ab"}
    assert found["pipeline"]["stage"][0] == {
        "use": "nudge",
        "as": None,
        "after": None,
        "share": 1.0,
        "limit": 50.0,
        "mode": "mean",
    }
    assert set(found["versions"]) == {"python", "o3dls", "numpy", "scipy", "open3d", "pymeshlab", "numba"}
    assert {"seeds", "threads"} <= set(found)
    one = found["estimates"]["nudge"]
    assert {
        "status",
        "converged",
        "seconds",
        "iterations",
        "T_map_prior",
        "scale",
        "sigma_mm",
        "scores",
        "validity",
    } <= set(one)
    assert set(one["scores"]) == ALL_SETS
    assert all(set(scores) == POINT_SET for name, scores in one["scores"].items() if name != "truth")
    assert set(one["scores"]["truth"]) == {
        "assd_mm",
        "hd95_mm",
        "dice",
        "within_1mm",
        "within_2mm",
        "within_3mm",
    }
    checked = {
        "watertight",
        "components",
        "euler",
        "self_intersections",
        "flipped_faces",
        "volume_ml",
        "volume_change",
    }
    assert set(one["validity"]) == checked


def test_scores_csv_says_the_same_one_row_per_estimate_and_set(tmp_path: Path) -> None:
    run = Pipeline([Nudge()]).run(ball_case())
    rows = list(csv.DictReader((run.write(tmp_path / "run") / "scores.csv").read_text().splitlines()))
    assert {(row["estimate"], row["set"]) for row in rows} == {
        (e, s) for e in ("start", "nudge") for s in ALL_SETS
    }
    for row in rows:
        for key, value in run.scores[row["estimate"]][row["set"]].items():
            assert float(row[key]) == value


@pytest.mark.usefixtures("tiny_stages")
@pytest.mark.parametrize("make", [ball_case, disc_case])
def test_a_run_is_read_back_as_it_was(tmp_path: Path, make: Any) -> None:
    run = Pipeline([Nudge(share=0.5)], [Note()]).run(make())
    back = read_run(run.write(tmp_path / "run"))
    assert record(back) == record(run)
    assert str(back) == str(run)
    assert pipeline_from(back.provenance.pipeline | {"write": []}) == Pipeline([Nudge(share=0.5)])
    for name, estimate in run.estimates.items():
        again = back.estimates[name]
        np.testing.assert_allclose(again.surface.vertices, estimate.surface.vertices, atol=1e-12)
        assert again.trace == estimate.trace
    np.testing.assert_array_equal(back.points.xyz, run.points.xyz)
    assert set(back.points.columns) == set(run.points.columns)


class Warned(Nudge):
    """Is not sure, and hands on what was not before."""

    name: ClassVar[str] = "warned"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        own = RunWarning("other", f"the map is not sure of {self.estimate_name}")
        return replace(super().__call__(case, start), warnings=(*start.warnings, own))


def test_warnings_keep_their_code_and_the_stage_that_they_came_from(tmp_path: Path) -> None:
    run = Pipeline([Warned(as_="first"), Warned(as_="second")], folds=0).run(ball_case())
    folder = run.write(tmp_path / "run")
    found = json.loads((folder / "run.json").read_text())["estimates"]
    first, second = (
        {"code": "other", "stage": name, "sentence": f"the map is not sure of {name}"}
        for name in ("first", "second")
    )
    assert found["first"]["warnings"] == [first]
    assert found["second"]["warnings"] == [first, second]
    back = read_run(folder).estimates
    assert {name: one.warnings for name, one in back.items()} == {
        name: one.warnings for name, one in run.estimates.items()
    }
    text = (folder / "run.json").read_text().replace('"other"', '"newer"')
    (folder / "run.json").write_text(text)
    with pytest.raises(InputError, match="warning code 'newer' is unknown"):
        read_run(folder)


def test_an_estimate_after_a_change_of_topology_may_have_handles() -> None:
    run = Pipeline([Warned()], folds=0).run(ball_case())
    one_handle = {**run.validity, "warned": {**run.validity["warned"], "euler": 0}}
    plain = replace(run, validity=one_handle)
    assert plain.faults_of("warned")
    facts = {"changes": ["added a tube"]}
    changed = {**run.estimates, "warned": replace(run.estimates["warned"], facts=facts)}
    assert not replace(plain, estimates=changed).faults_of("warned")


def test_surfaces_carry_what_each_vertex_knows(tmp_path: Path) -> None:
    case = ball_case()
    folder = Pipeline([Nudge(share=0.5)], folds=0).run(case).write(tmp_path / "run")
    for suffix in ("ply", "vtp"):
        surface = read_surface(folder / f"estimates/nudge/surface.{suffix}")
        assert {"displacement_mm", "distance_to_nearest_point_mm", "prior_only"} <= set(surface.fields)
        np.testing.assert_allclose(surface.fields["displacement_mm"], 0.0, atol=1e-6)  # nothing but a shift
        nearest = np.linalg.norm(surface.vertices[:, None] - case.points.of("eam").xyz, axis=2).min(axis=1)
        np.testing.assert_allclose(surface.fields["distance_to_nearest_point_mm"], nearest, atol=1e-5)
        np.testing.assert_array_equal(surface.fields["prior_only"], nearest > 10.0)


@pytest.mark.usefixtures("tiny_stages")
def test_ablation_points_tell_of_the_wall_where_they_are_fitted(tmp_path: Path) -> None:
    case = ball_case()
    folder = Pipeline([Nudge(), Greedy()], folds=0).run(case).write(tmp_path / "run")
    for name, types in {"nudge": ["eam"], "greedy": ["eam", "ablation"]}.items():
        surface = read_surface(folder / f"estimates/{name}/surface.ply")
        nearest = np.linalg.norm(surface.vertices[:, None] - case.points.of(*types).xyz, axis=2).min(axis=1)
        np.testing.assert_allclose(surface.fields["distance_to_nearest_point_mm"], nearest, atol=1e-5)


@pytest.mark.parametrize("make", [ball_case, disc_case])
def test_electrical_values_of_the_points_reach_the_wall(make: Any, tmp_path: Path) -> None:
    case = make()
    height = np.where(case.points.type == "eam", case.points.xyz[:, -1], np.nan)
    case = replace(case, points=replace(case.points, columns={**case.points.columns, "lat": height}))
    folder = Pipeline([Nudge()], folds=0).run(case).write(tmp_path / "run")
    surface = read_surface(folder / f"estimates/nudge/surface.{'ply' if case.dimension == 3 else 'csv'}")
    known = np.isfinite(surface.fields["lat"])
    assert known.any()
    assert np.abs(surface.fields["lat"] - surface.vertices[:, -1])[known].mean() < 0.1 * np.ptp(
        surface.vertices[:, -1]
    )


def test_points_carry_their_distance_to_every_estimate(tmp_path: Path) -> None:
    run = Pipeline([Nudge()]).run(ball_case())
    points = read_points(run.write(tmp_path / "run") / "points.csv")
    eam, marks = points.of("eam"), points.of("landmark")
    assert eam.columns["distance_nudge_mm"].mean() == pytest.approx(run.scores["nudge"]["fitted"]["mean_mm"])
    assert eam.columns["left_out_nudge_mm"].mean() == pytest.approx(
        run.scores["nudge"]["cross_validated"]["mean_mm"]
    )
    assert marks.columns["distance_nudge_mm"].mean() == pytest.approx(
        run.scores["nudge"]["landmarks"]["mean_mm"]
    )
    # a partner of another name is one as well
    case = ball_case()
    ours = {"": "", "a": "LSPV", "b": "RSPV", "c": "septum"}
    names = np.array([ours[name] for name in case.points.columns["name"]])
    theirs = {"a": "left upper PV", "b": "RUPV", "c": "roof"}
    prior = {theirs[name]: at for name, at in case.prior_landmarks.items()}
    case = replace(case, points=replace(case.points, columns={"name": names}), prior_landmarks=prior)
    synonyms = Pipeline([Nudge()]).run(case).points.of("landmark")
    np.testing.assert_allclose(
        synonyms.columns["distance_nudge_mm"], [*marks.columns["distance_nudge_mm"][:2], np.nan]
    )
    held_out = read_points(tmp_path / "run/held_out.csv")
    assert held_out.columns["distance_nudge_mm"].max() == pytest.approx(
        run.scores["nudge"]["held_out"]["max_mm"]
    )


def test_equal_runs_give_equal_folders_but_for_times(tmp_path: Path) -> None:
    one, two = (Pipeline([Nudge()]).run(ball_case()).write(tmp_path / name) for name in ("one", "two"))
    files = sorted(p.relative_to(one) for p in one.rglob("*") if p.is_file())
    assert files == sorted(p.relative_to(two) for p in two.rglob("*") if p.is_file())
    for file in files:
        if file.name == "run.json":
            assert without_times(json.loads((one / file).read_text())) == without_times(
                json.loads((two / file).read_text())
            )
        else:
            assert (one / file).read_bytes() == (two / file).read_bytes(), file


def test_an_existing_folder_is_only_replaced_when_told(tmp_path: Path) -> None:
    run = Pipeline([Nudge()], folds=0).run(ball_case())
    run.write(tmp_path / "run")
    with pytest.raises(InputError, match="exists already; name another folder or use --force"):
        run.write(tmp_path / "run")
    run.write(tmp_path / "run", force=True)
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def test_a_writer_that_fails_leaves_no_folder(tmp_path: Path) -> None:
    with pytest.raises(SolverError):
        Pipeline([Nudge()], [Note(fail=True)], folds=0).run(ball_case()).write(tmp_path / "run")
    assert list(tmp_path.iterdir()) == []


def test_a_failed_run_leaves_only_a_log_that_says_why(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with pytest.raises(SolverError), log_of_failure(out):
        Pipeline([Nudge(), Stuck()], folds=0).run(ball_case()).write(out)
    assert [p.name for p in tmp_path.iterdir()] == ["run.failed.log"]
    said = (tmp_path / "run.failed.log").read_text()
    assert "nudge: shifted by" in said
    assert "SolverError: no step lowers the energy" in said


def test_a_log_of_failure_goes_with_the_failure(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with pytest.raises(SolverError), log_of_failure(out):
        raise SolverError("at first")
    with log_of_failure(out):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_log_that_cannot_be_written_does_not_hide_the_failure(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SolverError, match="at first"), log_of_failure(tmp_path / "file" / "run"):
        raise SolverError("at first")


def test_columns_of_the_points_travel_to_the_run(tmp_path: Path) -> None:
    case = ball_case()
    own = dict.fromkeys(("distance_to_ostium_mm", "distance_nudge_mm"), np.full(len(case.points), -1.0))
    case = replace(case, points=replace(case.points, columns={**case.points.columns, **own}))
    columns = Pipeline([Nudge()], folds=0).run(case).points.columns
    assert set(columns) == {"name", "distance_to_ostium_mm", "distance_start_mm", "distance_nudge_mm"}
    assert (columns["distance_to_ostium_mm"] == -1.0).all()
    assert (columns["distance_nudge_mm"] >= 0.0).all()  # of an earlier run no more


def test_a_page_is_no_part_of_a_run_and_no_pdf(tmp_path: Path) -> None:
    run = Pipeline([Nudge()], folds=0).run(ball_case()).write(tmp_path / "run")
    before = sorted(run.rglob("*"))
    for write in (write_report, compare):
        with pytest.raises(
            InputError, match=r"run\.json: is written as HTML; name a file that ends in \.html or \.htm"
        ):
            write([run], run / "run.json")
        with pytest.raises(InputError, match="belongs to the run in"):
            write([run], run / "estimates" / "page.html")
    assert sorted(run.rglob("*")) == before


def test_an_invalid_surface_is_written_and_named() -> None:
    run = Pipeline([Nudge(), Broken()], folds=0).run(ball_case())
    assert run.faults == ["the surface is inside out"]
    assert run.faults_of("nudge") == []


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (None, "is not a run folder"),
        ("{", "run.json"),
        ("[]", "run.json: schema is not there: must be 'o3dls/run/2'"),
        ('{"schema": "other/2"}', "schema is 'other/2': must be 'o3dls/run/2'"),
        ('{"schema": "o3dls/run/2"}', "run.json: has no 'case', so it is not a finished run"),
    ],
)
def test_what_is_no_run_is_refused(tmp_path: Path, content: str | None, sentence: str) -> None:
    if content is not None:
        (tmp_path / "run.json").write_text(content)
    with pytest.raises(InputError, match=sentence):
        read_run(tmp_path)


KILLED = """
import time
from pathlib import Path
from tiny import Nudge, ball_case
from o3dls.pipeline.pipeline import Pipeline
from o3dls.runs.writers import Writer
class Slow(Writer):
    name = "slow"
    def __call__(self, run, folder):
        print("writing", flush=True)
        time.sleep(60)
Pipeline([Nudge()], [Slow()], folds=0).run(ball_case()).write({out!r})
"""


def test_a_killed_run_leaves_no_folder_that_looks_finished(tmp_path: Path) -> None:
    code = KILLED.replace("{out!r}", repr(str(tmp_path / "run")))
    process = subprocess.Popen(
        [sys.executable, "-c", code], cwd=Path(__file__).parent, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    with process.stdout:
        assert process.stdout.readline() == "writing\n"
    process.kill()
    process.wait()
    assert not (tmp_path / "run").exists()
    assert all(p.name.startswith(".") for p in tmp_path.iterdir())
    # what is left behind stands in nobody's way
    Pipeline([Nudge()], folds=0).run(ball_case()).write(tmp_path / "run")


def test_the_deviation_in_the_files_is_that_of_the_estimate(tmp_path: Path) -> None:
    run = Pipeline([Deform()], folds=0).run(ball_case())
    folder = run.write(tmp_path / "run")
    written = read_surface(folder / "estimates/deform/surface.ply").fields["sd_mm"]
    np.testing.assert_allclose(written, run.estimates["deform"].surface.fields["sd_mm"], rtol=1e-5)


@cache
def nudged(*writers: type[Writer]) -> Run:
    """A run that is written again and again: writing changes nothing of it."""
    return Pipeline([Nudge()], [kind() for kind in writers], folds=0).run(ball_case())


def a_run(folder: Path) -> Path:
    return nudged(Note).write(folder)


@pytest.mark.parametrize("name", ["thesis.docx", "export/thesis.docx", "case2/points.csv", "case/notes.txt"])
@pytest.mark.parametrize("manifest", [True, False])
def test_a_run_with_a_file_that_is_not_ours_is_not_replaced(
    name: str, manifest: bool, tmp_path: Path
) -> None:
    out = a_run(tmp_path / "run")
    if not manifest:
        (out / "manifest.txt").unlink()  # as of an older version, and those have no note.txt
        (out / "note.txt").unlink()
    (out / name).parent.mkdir(exist_ok=True)
    (out / name).write_text("keep me")
    with pytest.raises(InputError, match=f"run: holds {name}, which o3dls did not write and would remove"):
        nudged().write(out, force=True)
    assert (out / name).read_text() == "keep me"
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    (out / name).unlink()
    (out / ".DS_Store").write_text("")
    (out / "empty").mkdir()
    nudged().write(out, force=True)
    assert not (out / "note.txt").exists()


def test_a_link_in_a_run_folder_is_not_ours_either(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    out = a_run(tmp_path / "run")
    (out / "link").symlink_to(tmp_path / "there")
    (out / "thesis.docx").write_text("")
    with pytest.raises(InputError, match=r"run: holds link and 1 more, which"):
        nudged().write(out, force=True)


def test_what_report_and_export_add_to_a_run_is_replaced_with_it(tmp_path: Path) -> None:
    out = a_run(tmp_path / "run")
    export_run(out, format="stl")
    write_report([out], out / "another.html", pdf=True)
    files = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    listed = [json.loads(line) for line in (out / "manifest.txt").read_text().splitlines()]
    assert {"export/nudge.stl", "export/nudge.stl.json", "another.html", "another.pdf", "note.txt"} < files
    assert sorted(listed) == sorted(files - {"manifest.txt"})
    nudged().write(out, force=True)
    assert not (out / "export").exists()
