"""A pipeline: the same from text and from Python, every mistake named, nothing shown to a stage that it may
not see.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from numba import njit
from tiny import SHIFT, Greedy, Nudge, Spy, ball_case, disc_case, sphere, tiny_stages  # noqa: F401  (a fixture)

from o3dls.case import Case, Points
from o3dls.errors import InputError, PipelineError
from o3dls.geometry.similarity import similarity
from o3dls.geometry.surface import Surface
from o3dls.pipeline.file import pipeline_from, read_pipeline
from o3dls.pipeline.pipeline import Pipeline
from o3dls.runs.export.writer import Export
from o3dls.runs.run import Run
from o3dls.runs.writers import Writer

pytestmark = pytest.mark.usefixtures("tiny_stages")

TEXT = """
case = "cases/ball"
out = "runs/ball"
folds = 4
keep_last = true

[[stage]]
use = "nudge"
share = 0.5

[[stage]]
use = "nudge"
as = "rest"
after = "nudge"
mode = "median"
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "pipe.toml"
    path.write_text(text)
    return path


def mistakes(folder: Path, text: str, *settings: str) -> str:
    with pytest.raises(PipelineError) as error:
        read_pipeline(written(folder, text), settings)
    assert "\n" not in str(error.value)
    # what only the command line got wrong is not blamed on the file
    assert (str(folder / "pipe.toml") in str(error.value)) == (not settings)
    return str(error.value)


def test_text_and_python_give_equal_pipelines(tmp_path: Path) -> None:
    stages = [Nudge(share=0.5), Nudge(as_="rest", after="nudge", mode="median")]
    places = {"case": tmp_path / "cases/ball", "out": tmp_path / "runs/ball"}
    python = Pipeline(stages, **places, folds=4, keep_last=True)
    assert read_pipeline(written(tmp_path, TEXT)) == python
    assert read_pipeline(written(tmp_path, TEXT), ["rest.mode=mean"]) != python
    assert read_pipeline(written(tmp_path, TEXT), ["keep_last=false"]) == replace(python, keep_last=False)


def test_the_record_of_a_pipeline_gives_it_back(tmp_path: Path) -> None:
    pipeline = replace(read_pipeline(written(tmp_path, TEXT)), case=None, out=None)
    record = pipeline.record()
    assert record["stage"][0] == {
        "use": "nudge",
        "as": None,
        "after": None,
        "share": 0.5,
        "limit": 50.0,
        "mode": "mean",
    }
    assert pipeline_from(record) == pipeline


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('[[stage]]\nuse = "nudgee"', "[[stage]] 1: no stage 'nudgee': did you mean 'nudge'?"),
        ('[[stage]]\nuse = "nudge"\nshar = 1', "nudge.shar: no such parameter: did you mean 'share'?"),
        (
            '[[stage]]\nuse = "nudge"\nlimit = -1.0',
            "nudge.limit = -1.0 mm: must be a number within (0, inf) mm",
        ),
        ('[[stage]]\nuse = "nudge"\nshare = "all"', "nudge.share = 'all': must be a number within [0, 1]"),
        ('[[stage]]\nuse = "nudge"\nmode = "meen"', "nudge.mode = 'meen': did you mean 'mean'?"),
        ('[[stage]]\nuse = "nudge"\nas = "1 2"', "nudge.as = '1 2': must be text that matches"),
        ('[[stage]]\nuse = "nudge"\n[[stage]]\nuse = "nudge"', "nudge: a second estimate named 'nudge'"),
        ('[[stage]]\nuse = "nudge"\nas_ = "a"', "nudge.as_: no such parameter: did you mean 'as'?"),
        ('[[stage]]\nuse = "nudge"\nas = "a"\nas_ = "b"', "nudge.as_: no such parameter: did you mean 'as'?"),
        ('[[stage]]\nuse = "nudge"\nafter = 3', "nudge.after = 3: must be a text"),
        ('[[stage]]\nuse = ["nudge"]', "[[stage]] 1: use = ['nudge']: must be the name of one stage"),
        ("[[stage]]\nuse = {a = 1}", "[[stage]] 1: use = {'a': 1}: must be the name of one stage"),
        ('[[stage]]\nuse = "nudge"\nas = "start"', "a second estimate named 'start'"),
        (
            '[[stage]]\nuse = "nudge"\nafter = "nugde"',
            "nudge.after = 'nugde': no such estimate: did you mean 'nudge'?",
        ),
        (
            '[[stage]]\nuse = "nudge"\nafter = "spy"\n[[stage]]\nuse = "spy"',
            "nudge.after = 'spy': is not made before nudge",
        ),
        ("[[stage]]\nshare = 1.0", "[[stage]] 1: use: is missing"),
        ("stage = 3", "stage = 3: must be a list of tables"),
        ("stage = [3]", "[[stage]] 1: must be a table, not 3"),
        ("folds = 3", "the pipeline has no stage"),
        (
            'folds = 1\n[[stage]]\nuse = "nudge"',
            "folds = 1: must be 0 (no cross-validation) or a whole number within [2, 50]",
        ),
        ('keep_last = 1\n[[stage]]\nuse = "nudge"', "keep_last = 1: must be true or false"),
        ('fold = 3\n[[stage]]\nuse = "nudge"', "fold: no such key: did you mean 'folds'?"),
        (
            '[[stage]]\nuse = "nudge"\n[[write]]\nuse = "reprot"',
            "[[write]] 1: no write 'reprot': did you mean 'report'?",
        ),
        ('[[stage]\nuse = "nudge"', "line 1"),
    ],
)
def test_every_mistake_is_named(tmp_path: Path, text: str, sentence: str) -> None:
    assert sentence in mistakes(tmp_path, text)


def test_all_mistakes_are_named_at_once(tmp_path: Path) -> None:
    said = mistakes(
        tmp_path, '[[stage]]\nuse = "nudge"\nshare = 7\nlimt = 1\n[[stage]]\nuse = "nudge"\nafter = "icp"'
    )
    for part in ("nudge.share = 7:", "nudge.limt", "a second estimate named 'nudge'"):
        assert part in said


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ("nudge.share=2", "nudge.share = 2: must be a number within [0, 1]"),
        ("icp.keep=2", "--set icp.keep=2: the pipeline has no 'icp'"),
        ("nudge", "--set nudge: must be STAGE.PARAM=VALUE"),
        ("folds=-2", "folds = -2"),
        ("case=a", "--set case=a: names a folder, not a parameter: use --case a"),
        ("out = b", "--set out = b: names a folder, not a parameter: use --out b"),
    ],
)
def test_settings_are_checked_like_files(tmp_path: Path, setting: str, sentence: str) -> None:
    assert sentence in mistakes(tmp_path, TEXT, setting)


def test_a_mistake_of_the_command_line_is_not_blamed_on_the_file(tmp_path: Path) -> None:
    path = tmp_path / "pipe.toml"
    path.write_text(TEXT)
    for settings, said in {
        ("nudge.share=2", "folds=2"): "--set nudge.share=2: [[stage]] 1: nudge.share = 2",
        ("folds=x", "nudge.share=0"): "--set folds=x: folds = 'x': must be a whole number",
        ("icp.keep=2",): "--set icp.keep=2: the pipeline has no 'icp'",
    }.items():
        with pytest.raises(PipelineError) as caught:
            read_pipeline(path, settings)
        (mistake,) = caught.value.args
        assert mistake.startswith(said)
    path.write_text(TEXT.replace('use = "nudge"', 'use = "nudge"\nlimt = 1', 1))
    with pytest.raises(PipelineError) as caught:
        read_pipeline(path, ["nudge.share=2"])
    mistakes = caught.value.args
    assert any(said.startswith(f"{path}: ") and "nudge.limt" in said for said in mistakes)
    assert any(said.startswith("--set nudge.share=2: ") and "nudge.limt" not in said for said in mistakes)


EXPORTS = '[[stage]]\nuse = "nudge"\n[[write]]\nuse = "export"\n[[write]]\nuse = "export"\n'


@pytest.mark.parametrize("second", ["faces = 4", 'estimate = "nudge"'])
def test_writers_that_would_overwrite_each_other_are_refused(tmp_path: Path, second: str) -> None:
    assert "export nudge ply: two writers would overwrite" in mistakes(tmp_path, EXPORTS + second)


class Shot(Writer):
    """Another package's writer: what tells two of them apart is theirs."""

    name: ClassVar = "shot"
    file: str = "front.png"

    def __call__(self, run: Run, folder: Path) -> None: ...


def test_writers_of_other_packages_differ_by_all_their_parameters() -> None:
    assert len(Pipeline([Nudge()], writes=[Shot(), Shot(file="back.png")]).writes) == 2
    with pytest.raises(PipelineError, match=r"shot front\.png: two writers would overwrite"):
        Pipeline([Nudge()], writes=[Shot(), Shot()])


@pytest.mark.parametrize("second", ['format = "stl"', 'estimate = "start"'])
def test_a_setting_for_one_of_two_writers_is_refused(tmp_path: Path, second: str) -> None:
    assert len(read_pipeline(written(tmp_path, EXPORTS + second)).writes) == 2
    assert "the pipeline has 2 named 'export'" in mistakes(tmp_path, EXPORTS + second, "export.faces=100")


def test_settings_reach_text_numbers_and_top_keys(tmp_path: Path) -> None:
    pipeline = read_pipeline(written(tmp_path, TEXT), ["rest.mode=mean", "nudge.share=0.25", "folds=0"])
    assert (pipeline.stages[1].mode, pipeline.stages[0].share, pipeline.folds) == ("mean", 0.25, 0)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("setting", "share"), [("nudge.share=.25", 0.25), ("nudge.share=+1.", 1.0), ("nudge.share=1", 1.0)]
)
def test_settings_are_numbers_as_people_write_them(tmp_path: Path, setting: str, share: float) -> None:
    assert read_pipeline(written(tmp_path, TEXT), [setting]).stages[0].share == share  # type: ignore[attr-defined]


def test_a_wrong_parameter_from_python_is_the_same_sentence() -> None:
    with pytest.raises(PipelineError, match=r"^nudge.share = -1: must be a number within \[0, 1\]$"):
        Nudge(share=-1)


def test_stages_start_from_the_one_before_or_the_one_named() -> None:
    pipeline = Pipeline([Nudge(), Nudge(as_="second", share=0.0), Nudge(as_="third", after="start")], folds=0)
    assert pipeline.sources == {"nudge": "start", "second": "nudge", "third": "start"}
    estimates = pipeline.run(ball_case()).estimates
    assert list(estimates) == ["start", "nudge", "second", "third"]
    np.testing.assert_array_equal(estimates["second"].T_map_prior, estimates["nudge"].T_map_prior)


def test_no_stage_can_read_what_is_for_evaluation_only() -> None:
    Spy.seen.clear()
    Pipeline([Spy()], folds=3).run(ball_case())
    assert len(Spy.seen) == 4
    for case in Spy.seen:
        assert case.truth is None
        assert not case.files
        assert set(case.points.type.tolist()) <= {"eam", "landmark"}
        assert len(case.points.of("ablation")) == 0


def test_deleting_the_truth_changes_nothing() -> None:
    case = ball_case()
    pipeline = Pipeline([Nudge()], folds=0)
    with_truth = pipeline.run(case)
    without = pipeline.run(replace(case, truth=None))
    np.testing.assert_array_equal(
        with_truth.estimates["nudge"].surface.vertices, without.estimates["nudge"].surface.vertices
    )
    assert without.scores["nudge"] == {
        k: v for k, v in with_truth.scores["nudge"].items() if k in without.scores["nudge"]
    }


def test_points_that_were_fitted_upstream_are_never_scored_as_held_out() -> None:
    run = Pipeline(
        [Nudge(), Greedy(), Nudge(as_="after_greedy"), Nudge(as_="clean", after="nudge")], folds=0
    ).run(ball_case())
    has_ablation = {name: "ablation" in sets for name, sets in run.scores.items()}
    assert has_ablation == {
        "start": True,
        "nudge": True,
        "greedy": False,
        "after_greedy": False,
        "clean": True,
    }
    assert run.scores["greedy"]["fitted"]["n"] == run.scores["nudge"]["fitted"]["n"] + 10


class TestStart:
    def test_three_landmarks_come_first(self) -> None:
        start = (
            Pipeline([Nudge()], folds=0)
            .run(replace(ball_case(), init=similarity(np.eye(3), SHIFT * 2)))
            .estimates["start"]
        )
        assert start.status.startswith("rigid fit of 3 landmarks (a, b, c)")
        np.testing.assert_allclose(start.T_map_prior, similarity(np.eye(3), SHIFT), atol=1e-12)

    def test_init_comes_second_and_identity_last(self) -> None:
        case = replace(ball_case(), prior_landmarks={})
        assert "prior as given" in self.status(case)
        assert "init" in self.status(replace(case, init=similarity(np.eye(3), SHIFT)))

    def test_landmarks_on_a_line_fix_no_pose(self) -> None:
        case = ball_case()
        line = {name: np.array([0.0, 0.0, z]) for name, z in zip("abc", (-20.0, 0.0, 20.0), strict=True)}
        assert "on one line" in self.status(replace(case, prior_landmarks=line))

    def status(self, case: Any) -> str:
        return Pipeline([Nudge()], folds=0).run(case).estimates["start"].status


IN_FILES = {"points.csv": "0" * 64}  # what a case of files holds, and one of arrays does not


@pytest.mark.parametrize("files", [IN_FILES, {}], ids=["files", "arrays"])
@pytest.mark.parametrize(
    ("factor", "shift", "sentence"),
    [
        (1e-3, 0.0, "in m, (add|multiply them by 1000)"),
        (0.1, 0.0, "in cm, (add|multiply them by 10;)"),
        (1e3, 0.0, "in um, (add|multiply them by 0.001)"),
        (1e-9, 0.0, "no unit explains that: do nearly all points lie in one place"),
        (1.0, 900.0, "half of the points are more than"),
    ],
)
def test_points_that_cannot_belong_to_the_prior_are_refused(
    factor: float, shift: float, sentence: str, files: dict[str, str]
) -> None:
    case = replace(ball_case(), prior_landmarks={}, files=files)
    case = replace(case, points=replace(case.points, xyz=case.points.xyz * factor + shift))
    with pytest.raises(InputError, match=sentence):
        Pipeline([Nudge()], folds=0).run(case)


@pytest.mark.parametrize(
    ("files", "sentence"),
    [(IN_FILES, "the prior is in m, write it in mm"), ({}, "prior are in m, multiply them by 1000")],
    ids=["files", "arrays"],
)
def test_a_prior_in_another_unit_than_mm_is_told_from_points_that_are(
    files: dict[str, str], sentence: str
) -> None:
    case = replace(ball_case(), prior=sphere(0.02), prior_landmarks={}, files=files)
    with pytest.raises(InputError, match=sentence):
        Pipeline([Nudge()], folds=0).run(case)


def test_a_place_that_was_mapped_densely_says_nothing_of_units() -> None:
    case = ball_case(40)
    xyz = case.points.of("eam").xyz
    dense = xyz[0] + np.random.default_rng(3).normal(0.0, 0.5, (800, 3))
    case = replace(
        case,
        points=Points(np.vstack([xyz, dense]), np.full(840, "eam")),
        prior_landmarks={},
        init=similarity(np.eye(3), SHIFT),
    )
    assert not Pipeline([Nudge()], folds=0).refusals(case)


def test_what_ends_a_run_before_any_work_is_found_by_check() -> None:
    case = ball_case(30)
    assert "folds = 40: 30 points of type eam are there" in Pipeline([Nudge()], folds=40).refusals(case)[0]
    for spacing in (50.0, 0.01):
        pipeline = Pipeline([Nudge()], folds=0, writes=[Export(format="phi_nrrd", spacing=spacing)])
        assert f"export: spacing = {spacing:g}: a volume of" in pipeline.refusals(case)[0]


def test_a_stray_point_is_named() -> None:
    case = ball_case()
    wild = 7
    far = replace(case.points, xyz=case.points.xyz + 9e3 * (np.arange(len(case.points)) == wild)[:, None])
    with pytest.raises(InputError, match=rf"the point in row {wild} \(counted from 0\) lies"):
        Pipeline([Nudge()], folds=0).run(replace(case, points=far))


def test_points_in_one_place_are_refused() -> None:
    case = ball_case()
    same = replace(case.points, xyz=np.where(case.points.type[:, None] == "eam", SHIFT, case.points.xyz))
    with pytest.raises(InputError, match="have 1 different positions: at least 10 are needed"):
        Pipeline([Nudge()], folds=0).run(replace(case, points=same))


@pytest.mark.parametrize("case", [ball_case(), disc_case()], ids=["3D", "2D"])
def test_a_prior_that_encloses_nothing_is_refused(case: Case) -> None:
    flat = case.prior.with_vertices(case.prior.vertices * ([1.0] * (case.dimension - 1) + [0.0]))
    with pytest.raises(InputError, match="the prior is flat"):
        Pipeline([Nudge()], folds=0).run(replace(case, prior=flat))


def test_a_piece_of_the_prior_without_points_is_warned_of() -> None:
    case = ball_case()
    apart = Surface(case.prior.vertices + np.array([200.0, 0.0, 0.0]), case.prior.faces)
    both = Surface(
        np.vstack([case.prior.vertices, apart.vertices]),
        np.vstack([case.prior.faces, apart.faces + len(apart.vertices)]),
    )
    said = [
        Pipeline([Spy()], folds=0).run(replace(case, prior=prior)).estimates["spy"].warnings
        for prior in (case.prior, both)
    ]
    assert said[0] == ()
    (warning,) = said[1]
    assert (warning.code, warning.stage) == ("component-without-points", "start")
    assert "around (200, 0, 0) mm (50% of its area)" in warning.sentence


def test_points_far_away_are_no_mistake_where_a_stage_finds_the_pose() -> None:
    class Finder(Nudge):
        finds_pose = True

    case = replace(ball_case(), prior_landmarks={})
    far = replace(case, points=replace(case.points, xyz=case.points.xyz + 900.0))
    run = Pipeline([Finder(limit=1e4)], folds=0).run(far)
    assert run.scores["nudge"]["fitted"]["mean_mm"] < 1.0


def test_too_few_points_are_refused() -> None:
    with pytest.raises(InputError, match="have 9 different positions: at least 10"):
        Pipeline([Nudge()], folds=0).run(ball_case(points=9))


def test_a_stage_that_cannot_work_on_the_case_is_refused_or_left_out() -> None:
    class Solid(Nudge):
        def obstacle(self, case: Any) -> str | None:
            return "needs a 3D case" if case.dimension == 2 else None

    pipeline = Pipeline([Solid(as_="solid"), Nudge()], folds=0)
    with pytest.raises(InputError, match="case disc: nudge: needs a 3D case"):
        pipeline.run(disc_case())
    assert pipeline.allowed_by(disc_case()) == Pipeline([Nudge()], folds=0)
    assert pipeline.allowed_by(ball_case()) == pipeline


def test_compiling_is_said_once_and_only_where_it_happens(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first run of a version is a minute longer, and would seem to hang."""
    plan = Pipeline([Nudge()], folds=0)
    case = ball_case()
    plain = Nudge.__call__
    plan.run(case)
    caplog.set_level(logging.INFO, "o3dls")
    plan.run(case)
    assert "compiling" not in caplog.text

    def compiling(self: Nudge, case: Any, before: Any) -> Any:
        for start in (1, 2):
            njit(lambda x, start=start: x + start)(1)
        return plain(self, case, before)

    monkeypatch.setattr(Nudge, "__call__", compiling)
    plan.run(case)
    assert [record.message[:9] for record in caplog.records].count("compiling") == 1
