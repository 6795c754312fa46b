"""The command line as users meet it: a process of its own, its exit code, one line on stderr, no half-made
folder.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny import Nudge, ball_case, disc_case

from o3dls.case import Case
from o3dls.geometry.similarity import similarity
from o3dls.geometry.surface import Surface
from o3dls.io.case_writer import write_case
from o3dls.pipeline.file import default_pipeline
from o3dls.pipeline.pipeline import Pipeline
from o3dls.runs.folder import repeats
from o3dls.runs.run import record

ICP = 'folds = 0\n[[stage]]\nuse = "icp"\n'


def o3dls(*arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "error", "-m", "o3dls", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=300)


@pytest.fixture
def case(tmp_path: Path) -> Path:
    write_case(tmp_path / "ball", ball_case())
    return tmp_path / "ball"


@pytest.fixture
def pipeline(tmp_path: Path) -> Path:
    (tmp_path / "pipe.toml").write_text(ICP)
    return tmp_path / "pipe.toml"


def refused(done: subprocess.CompletedProcess[str], *sentences: str) -> None:
    """Exit code 2, nothing on stdout, and one line on stderr that holds the sentences."""
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1, done.stderr
    for sentence in sentences:
        assert sentence in done.stderr


def test_a_run_ends_with_its_folder_and_its_table(case: Path, pipeline: Path, tmp_path: Path) -> None:
    done = o3dls(
        "run", pipeline, "--case", case, "--out", tmp_path / "run", "--set", "icp.iterations=50", cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert "icp" in done.stdout
    assert str(tmp_path / "run") in done.stdout
    assert "icp: converged" in done.stderr
    found = json.loads((tmp_path / "run/run.json").read_text())
    assert found["pipeline"]["stage"][0]["iterations"] == 50
    assert found["case"]["files"].keys() >= {"prior.ply", "points.csv"}
    assert not list(tmp_path.glob("*.log"))


def test_two_runs_of_the_command_give_equal_run_json_but_for_times(
    case: Path, pipeline: Path, tmp_path: Path
) -> None:
    texts = []
    for name in ("one", "two"):
        assert o3dls("run", pipeline, "--case", case, "--out", name, cwd=tmp_path).returncode == 0
        lines = (tmp_path / name / "run.json").read_text().splitlines()
        texts.append([line for line in lines if '"seconds"' not in line])
    assert texts[0] == texts[1]


def test_folders_in_a_pipeline_are_relative_to_its_file(case: Path, tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/pipe.toml").write_text(f'case = "../{case.name}"\nout = "../runs/ball"\n{ICP}')
    assert o3dls("run", "sub/pipe.toml", cwd=tmp_path).returncode == 0
    assert (tmp_path / "runs/ball/run.json").is_file()


def test_an_invalid_result_is_written_and_ends_with_1(case: Path, pipeline: Path, tmp_path: Path) -> None:
    code = (
        "import sys; sys.path.insert(0, sys.argv.pop(1)); import tiny; from importlib.metadata import "
        "EntryPoint; from o3dls.plugins import plugin;"
        "known = plugin.registered; entry = EntryPoint('broken', 'tiny:Broken', 'o3dls.stages');"
        "plugin.registered = lambda g: {**known(g), 'broken': entry}; from o3dls.cli.main import main; main()"
    )
    pipeline.write_text(ICP + '[[stage]]\nuse = "broken"\n')
    command = [
        sys.executable,
        "-c",
        code,
        str(Path(__file__).parents[1]),
        "run",
        "pipe.toml",
        "--case",
        str(case),
        "--out",
        "run",
    ]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    assert "the result is not valid: broken: the surface is inside out" in done.stderr
    assert json.loads((tmp_path / "run/run.json").read_text())["valid"] is False


def test_check_names_every_mistake_and_runs_nothing(case: Path, tmp_path: Path) -> None:
    good, bad = tmp_path / "good.toml", tmp_path / "bad.toml"
    good.write_text(ICP)
    bad.write_text('[[stage]]\nuse = "icp"\ntolerance = -1.0\nkeeep = 0.5\n[[stage]]\nuse = "icpp"\n')
    done = o3dls("check", good, "--case", case, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, f"{good}: no mistakes\n")
    done = o3dls("check", bad, cwd=tmp_path)
    assert done.returncode == 2
    lines = done.stderr.splitlines()
    assert len(lines) == 3
    assert "bad.toml: [[stage]] 1: icp.tolerance = -1.0 mm: must be a number within [0, inf) mm" in lines[0]
    assert "icp.keeep: no such parameter: did you mean 'keep'?" in lines[1]
    assert "[[stage]] 2: no stage 'icpp': did you mean 'icp'?" in lines[2]


def test_check_names_mistakes_of_folders_too(case: Path, tmp_path: Path) -> None:
    (case / "prior.ply").unlink()
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken/file").write_text("mine")
    (tmp_path / "pipe.toml").write_text(f'case = "{case.name}"\nout = "taken"\n{ICP}')
    lines = o3dls("check", "pipe.toml", cwd=tmp_path).stderr.splitlines()
    assert len(lines) == 2
    assert "taken: is not a run" in lines[0]
    assert "no prior surface" in lines[1]


def test_check_says_what_run_would_refuse_and_an_earlier_run_is_no_mistake(
    case: Path, pipeline: Path, tmp_path: Path
) -> None:
    write_case(
        tmp_path / "far",
        replace(ball_case(), prior_landmarks={}, init=similarity(np.eye(3), np.full(3, 900.0))),
    )
    for command in ("check", "run"):
        out = ("--out", "run") if command == "run" else ()
        refused(
            o3dls(command, pipeline, "--case", "far", *out, cwd=tmp_path), "half of the points are more than"
        )
    pipeline.write_text(f'case = "{case.name}"\nout = "done"\n{ICP}')
    for command in ("check", "run", "check"):
        assert o3dls(command, pipeline, cwd=tmp_path).returncode == 0


def test_stages_lists_and_explains(tmp_path: Path) -> None:
    listed = o3dls("stages", cwd=tmp_path)
    one = o3dls("stages", "icp", cwd=tmp_path)
    for name in ("landmarks", "icp", "global_pose", "deform", "level_set", "report", "export"):
        assert f"use = {name} " in listed.stdout
    assert "tolerance = 0.005 mm" in one.stdout
    assert "[0, inf)" in one.stdout
    refused(o3dls("stages", "icpp", cwd=tmp_path), "no stage or writer 'icpp': did you mean 'icp'?")


def test_batch_gives_a_folder_per_case_and_one_table(case: Path, pipeline: Path, tmp_path: Path) -> None:
    write_case(tmp_path / "small", replace(ball_case(), name="small"))
    (tmp_path / "broken").mkdir()
    done = o3dls("batch", case, "small", "broken", "--pipeline", pipeline, "--out", "runs", cwd=tmp_path)
    assert done.returncode == 2
    assert "ball: done\nsmall: done\nbroken: broken: no prior surface" in done.stdout
    grades = next(line for line in done.stdout.splitlines() if line.startswith("Grades: "))
    assert sum(int(word) for word in grades.split() if word.isdigit()) == 2
    rows = (tmp_path / "runs/cohort.csv").read_text().splitlines()
    assert rows[0].startswith("case,error,faults,warnings,estimate,set,n,mean_mm")
    assert {row.split(",")[0] for row in rows[1:]} == {"ball", "small", "broken"}
    there = ["ball", "broken.failed.json", "cohort.csv", "cohort.html", "small"]
    assert sorted(p.name for p in (tmp_path / "runs").iterdir()) == there
    text = (tmp_path / "runs/cohort.html").read_text(encoding="utf-8")
    # the same prior and points under two names: one case
    assert "1 case, 2 runs compared" in text
    assert "<strong>broken</strong>: broken: no prior surface" in text
    refused(o3dls("batch", case, "--out", "runs", "--pipeline", pipeline, cwd=tmp_path), "exists already")


def test_compare_takes_cases_in_pixels_beside_those_in_millimetres(tmp_path: Path) -> None:
    for case in (ball_case(), disc_case()):
        Pipeline([Nudge()], folds=0).run(case).write(tmp_path / case.name)
    done = o3dls("compare", "ball", "disc", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    tables = done.stdout.split("run, case, estimate: mean distances in ")
    assert [(text[:2], "ball" in text, "disc" in text) for text in tables[1:]] == [
        ("mm", True, False),
        ("px", False, True),
    ]
    assert "2 cases, 2 runs compared" in (tmp_path / "compare.html").read_text(encoding="utf-8")


def test_only_a_run_is_replaced_by_a_run(case: Path, pipeline: Path, tmp_path: Path) -> None:
    write_case(tmp_path / "runs/case", ball_case())
    (tmp_path / "runs/run.json").write_text("")
    before = sorted(tmp_path.rglob("*"))
    for source, out in ((case, case), ("runs/case", "runs"), ("runs/case", case)):
        refused(o3dls("run", pipeline, "--case", source, "--out", out, "--force", cwd=tmp_path), "replace")
    for force in ((), ("--force",)):
        done = o3dls("demo", "--out", case, *force, cwd=tmp_path)
        refused(done, "is not a run, so o3dls does not replace it; name another folder\n")
    assert sorted(tmp_path.rglob("*")) == before


def test_a_demo_replaces_the_same_demo_only(case: Path, tmp_path: Path) -> None:
    plan = default_pipeline()
    subject = replace(ball_case(), files={"prior.ply": "ab"})
    found = record(Pipeline([Nudge()], folds=0).run(subject)).model_copy(update={"pipeline": plan.record()})
    (tmp_path / "run.json").write_text(found.text())
    assert repeats(tmp_path, plan.record(), subject)
    assert not repeats(tmp_path, replace(plan, folds=2).record(), subject)
    assert not repeats(tmp_path, plan.record(), replace(subject, files={"prior.ply": "cd"}))


def test_the_bare_command_shows_what_there_is(tmp_path: Path) -> None:
    done = o3dls(cwd=tmp_path)
    assert done.returncode == 0
    assert {"Usage:", "run", "report", "batch"} <= set(done.stdout.split())


def test_a_stdout_that_nobody_reads_is_no_invalid_result(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-m", "o3dls", "stages"], stdout=subprocess.PIPE, cwd=tmp_path
    ) as process:
        assert process.stdout is not None
        process.stdout.close()
    assert process.returncode == 141


def test_misuse_of_the_command_itself_is_one_line(pipeline: Path, tmp_path: Path) -> None:
    refused(o3dls("run", pipeline, cwd=tmp_path), "no --case given, and the pipeline names none")
    refused(o3dls("run", pipeline, "--casee", "x", cwd=tmp_path), "--casee")
    refused(
        o3dls("run", tmp_path, cwd=tmp_path),
        f"{tmp_path}: is a folder, not a pipeline file; if it is a case, say --case {tmp_path}",
    )
    refused(o3dls("runn", cwd=tmp_path), "runn")


class TestWrongInput:
    """Wrong input ends with exit code 2, one line that says what, where and what would be right, and no run
    folder.
    """

    @pytest.fixture(autouse=True)
    def _place(self, case: Path, pipeline: Path, tmp_path: Path) -> None:
        self.case, self.pipeline, self.folder = case, pipeline, tmp_path

    def refused(self, *sentences: str, options: tuple[str | Path, ...] = ()) -> None:
        refused(
            o3dls("run", self.pipeline, "--case", self.case, "--out", "run", *options, cwd=self.folder),
            *sentences,
        )
        assert not (self.folder / "run").exists()

    def rewrite(self, **changes: object) -> None:
        case: Case = replace(ball_case(), **changes)  # type: ignore[arg-type]
        write_case(self.case, case, force=True)

    def test_missing_case(self) -> None:
        self.case = self.folder / "nowhere"
        self.refused("nowhere: no such case folder")

    def test_missing_prior(self) -> None:
        (self.case / "prior.ply").unlink()
        self.refused("no prior surface", "there must be a file prior.ply")

    def test_empty_prior(self) -> None:
        (self.case / "prior.ply").write_bytes(b"")
        self.refused("prior.ply: is empty")

    def test_garbage_prior(self) -> None:
        (self.case / "prior.ply").write_bytes(b"\x00\x01garbage" * 40)
        self.refused("prior.ply")

    def test_truncated_prior(self) -> None:
        data = (self.case / "prior.ply").read_bytes()
        (self.case / "prior.ply").write_bytes(data[: len(data) // 2])
        self.refused("prior.ply")

    def test_prior_without_triangles(self) -> None:
        header = (
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty "
            "float z\nend_header\n0 0 0\n"
        )
        (self.case / "prior.ply").write_text(header)
        self.refused("prior.ply", "triangles")

    def test_prior_with_nan(self) -> None:
        text = "v 0 0 0\nv 40 0 0\nv 0 nan 0\nv 0 0 40\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
        (self.case / "prior.ply").unlink()
        (self.case / "prior.obj").write_text(text)
        self.refused("prior.obj", "not finite")

    def test_open_prior(self) -> None:
        prior = ball_case().prior
        self.rewrite(prior=Surface(prior.vertices, prior.faces[1:]))
        self.refused("prior.ply", "cap = true")

    def test_missing_points(self) -> None:
        (self.case / "points.csv").unlink()
        self.refused("no points.csv")

    def test_points_in_metres(self) -> None:
        points = ball_case().points
        self.rewrite(points=replace(points, xyz=points.xyz / 1000.0))
        self.refused("the points span 0.06", "if the points are in m, add the line '# units=m'")

    @pytest.mark.parametrize(("unit", "factor"), [("in", 25.4), ("cm", 10.0), ("m", 1000.0)])
    def test_a_prior_or_points_in_another_unit(self, unit: str, factor: float) -> None:
        points, prior = ball_case().points, ball_case().prior
        self.rewrite(points=replace(points, xyz=points.xyz / factor))
        self.refused(f"if the points are in {unit}, add the line '# units={unit}'")
        self.rewrite(points=points, prior=prior.with_vertices(prior.vertices / factor))
        self.refused(f"if the prior is in {unit}, write it in mm: o3dls convert PRIOR OUT --units {unit}")

    def test_no_point_near_the_prior(self) -> None:
        points = ball_case().points
        self.rewrite(points=replace(points, xyz=points.xyz + 500.0), prior_landmarks={})
        self.refused("half of the points are more than", "global_pose")

    def test_too_few_points(self) -> None:
        points = ball_case().points
        self.rewrite(points=points.select(np.r_[:9, 60 : len(points)]))
        self.refused("9 points of type eam", "at least 10")

    def test_unknown_point_type(self) -> None:
        text = (self.case / "points.csv").read_text()
        (self.case / "points.csv").write_text(text.replace(",ablation,", ",ablatoin,", 1))
        self.refused("points.csv: line 62, column 'type'", "did you mean 'ablation'?")

    def test_unpaired_landmarks(self) -> None:
        self.rewrite(prior_landmarks={"p": np.zeros(3), "q": np.ones(3), "r": np.arange(3.0)})
        self.refused("no landmark of the points (a, b, c) has its pair")

    def test_unknown_stage(self) -> None:
        self.pipeline.write_text('[[stage]]\nuse = "icpp"\n')
        self.refused("pipe.toml: [[stage]] 1: no stage 'icpp': did you mean 'icp'?")

    def test_misspelt_parameter(self) -> None:
        self.refused(
            "icp.tolerence: no such parameter: did you mean 'tolerance'?",
            options=("--set", "icp.tolerence=1"),
        )

    def test_value_out_of_bounds(self) -> None:
        self.refused(
            "icp.tolerance = -1.0 mm: must be a number within [0, inf) mm",
            options=("--set", "icp.tolerance=-1.0"),
        )

    def test_two_estimates_of_one_name(self) -> None:
        self.pipeline.write_text(ICP + '[[stage]]\nuse = "icp"\n')
        self.refused("a second estimate named 'icp'")

    def test_toml_that_is_none(self) -> None:
        self.pipeline.write_text('folds = 0\n[[stage]\nuse = "icp"\n')
        self.refused("pipe.toml", "line 2")

    def test_output_folder_that_exists(self) -> None:
        (self.folder / "taken").mkdir()
        (self.folder / "taken/file").write_text("mine")
        done = o3dls("run", self.pipeline, "--case", self.case, "--out", "taken", cwd=self.folder)
        refused(done, "taken: is not a run, so o3dls does not replace it; name another folder")
        assert [p.name for p in (self.folder / "taken").iterdir()] == ["file"]


def test_a_batch_goes_on_and_its_parts_give_the_table_of_the_whole(
    case: Path, pipeline: Path, tmp_path: Path
) -> None:
    write_case(tmp_path / "small", replace(ball_case(), name="small"))
    (tmp_path / "study.csv").write_text(
        f"case,pipeline\n{case.name},{pipeline.name}\nsmall,{pipeline.name}\n"
    )
    for part in ("1/2", "2/2"):
        done = o3dls("batch", "study.csv", "--out", "parts", "--shard", part, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    assert not list((tmp_path / "parts").glob("cohort.*"))
    told = o3dls("cohort", "parts", cwd=tmp_path)
    assert told.returncode == 0, told.stderr
    table = (tmp_path / "parts/cohort.csv").read_bytes()
    assert (tmp_path / "parts/cohort.html").is_file()
    whole = o3dls("batch", "study.csv", "--out", "parts", cwd=tmp_path)
    assert whole.stdout.count("its run is there already, skipped") == 2
    assert (tmp_path / "parts/cohort.csv").read_bytes() == table


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--timeout", "10", "'10': must be a number above 0 with one of s, m, h, d behind it, such as 10m"),
        ("--timeout", "0m", "must be a number above 0"),
        ("--memory", "2gb", "with one of MB, GB, MiB, GiB behind it, such as 2GB"),
        ("--shard", "5/4", "must be I/N with I from 1 to N, such as 1/4"),
        ("--shard", "0/4", "must be I/N"),
    ],
)
def test_limits_and_shards_that_cannot_be_meant_are_refused(
    option: str, value: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from o3dls.cli.main import answer

    assert answer(["batch", "none", "--out", str(tmp_path / "runs"), option, value]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()
