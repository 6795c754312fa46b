"""Sections: one without data drops out, a plugin's is shown, runs that differ in one number give a curve, the
pipeline reads back.
"""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from o3dls.pipeline.pipeline import Pipeline
from o3dls.report import section
from o3dls.report.drawing.charts import Axis, Series, axis_over, line_chart
from o3dls.report.drawing.distance_charts import MOST, beyond, cumulative, histogram, spread_section
from o3dls.report.drawing.fields import known_fields
from o3dls.report.grading.remarks import Remark, remarks
from o3dls.report.markup import signed, tag
from o3dls.report.palette import DARK, LIGHT, places
from o3dls.report.section import Section
from o3dls.report.sections.provenance import as_toml
from o3dls.report.sections.scores import validity_section
from o3dls.report.sections.sweep import swept
from o3dls.report.subject import Subject, read_subject
from o3dls.report.verdict import headline_difference
from o3dls.report.writer import compare, write_report
from o3dls.runs.folder import read_record
from o3dls.runs.record import Provenance
from tests.finished import SEED, Icp, LevelSet, bulged_case, finished, finished_2d, renamed
from tests.tiny import Nudge, ball_case, sphere


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(tmp_path_factory.mktemp("sections") / "run", folds=3)


def anchors(path: Path) -> list[str]:
    return re.findall(r'<section id="([^"]+)">', path.read_text(encoding="utf-8"))


def test_sections_with_data_are_there(run: Path) -> None:
    found = anchors(write_report([run]))
    wanted = [
        "pictures",
        "outcome",
        "scores",
        "contributions",
        "paired",
        "spread",
        "slices",
        "regions",
        "landmarks",
        "calibration",
        "electrical",
        "validity",
        "course",
        "methods",
        "made",
    ]
    assert found == wanted


BANNED = ("shreds", "lattice", "carry", "carried", "loosening", "say there", "left out in turn", "told apart")


def test_the_page_speaks_in_the_terms_of_the_field(run: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(run, tmp_path / "run"))
    record = json.loads((copy / "run.json").read_text())
    way = {
        "shift": [0.1, 0, 0],
        "turn_degrees": [1.0, 0, 0],
        "log_scale": 0.01,
        "meaning": "shift",
        "sd": 0.4,
    }
    record["estimates"]["icp"]["facts"] = {"observability": [way]}
    (copy / "run.json").write_text(json.dumps(record))
    trace = copy / "estimates/icp/trace.csv"
    trace.write_text(trace.read_text().replace("residual", "loosening"))
    page = re.sub(
        r"<script.*?</script>|<style.*?</style>", "", write_report([copy]).read_text(), flags=re.DOTALL
    )
    text = re.sub("<[^>]+>", " ", page)
    for word in (
        "Fused surface: level_set",
        "cross-validated points",
        "hatch: no points here, shape from the image",
        "no points here: shape from the image alone",
        "start (before registration)",
        "Pose uncertainty",
        "Is the uncertainty reliable?",
        "Share of outliers",
        "handles (0 = none)",
        "coarse-to-fine factor",
    ):
        assert word in text
    assert [word for word in BANNED if re.search(rf"\b{word}", text)] == []


def test_handles_are_counted_from_the_euler_number(run: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(run, tmp_path / "run"))
    record = json.loads((copy / "run.json").read_text())
    record["estimates"]["level_set"]["validity"]["euler"] = -2
    (copy / "run.json").write_text(json.dumps(record))
    section_ = validity_section(read_subject([copy]))
    heads = re.findall(r'<th scope="col">([^<]*)</th>', section_.body)
    rows = dict(re.findall(r'<th scope="row">([^<]+)</th>(.*?)</tr>', section_.body))
    k = heads.index("handles (0 = none)") - 1
    assert [re.findall("<td>([^<]*)</td>", rows[name])[k] for name in ("icp", "level_set")] == ["0", "2"]


def test_sections_without_data_drop_out(tmp_path: Path) -> None:
    case = bulged_case()
    bare = replace(case, truth=None, points=replace(case.points.of("eam"), columns={}), prior_landmarks={})
    assert not {"landmarks", "calibration", "electrical"} & set(
        anchors(write_report([finished(tmp_path / "run", bare)]))
    )
    assert not {"slices", "electrical"} & set(anchors(write_report([finished_2d(tmp_path / "flat")])))


def volume_section(subject: Subject) -> Section | None:
    return Section(
        "volume", "Volume <of the chamber>", tag("p", f"{subject.last.estimate.surface.volume:.0f} & more")
    )


def test_a_plugin_adds_a_section(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entry = EntryPoint("volume", "test_report_sections:volume_section", section.GROUP)
    monkeypatch.setattr(
        section, "registered", lambda group: {"volume": entry} if group == section.GROUP else {}
    )
    text = write_report([run], tmp_path / "plugin.html").read_text(encoding="utf-8")
    assert '<section id="volume"><h2>Volume &lt;of the chamber&gt;</h2>' in text


def test_regions_follow_the_landmarks(run: Path) -> None:
    text = write_report([run]).read_text(encoding="utf-8")
    assert "near LSPV" in text
    assert "elsewhere" in text


def test_left_out_landmarks_come_from_the_stage(run: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(run, tmp_path / "run")
    record = json.loads((copy / "run.json").read_text())
    record["estimates"]["icp"]["facts"] = {"landmarks": {"LSPV": {"error": 1.0, "leave_one_out": 7.125}}}
    (copy / "run.json").write_text(json.dumps(record))
    text = write_report([copy]).read_text(encoding="utf-8")
    assert "icp, leave-one-out" in text
    assert "7.12" in text


def test_runs_that_differ_in_one_number_give_a_curve(tmp_path: Path) -> None:
    shares = (0.25, 1.0, 0.5)
    folders = [
        Pipeline([Nudge(share=share)], folds=0).run(ball_case()).write(tmp_path / f"share_{share}")
        for share in shares
    ]
    text = write_report(folders, tmp_path / "sweep.html").read_text(encoding="utf-8")
    assert "Sensitivity to nudge.share" in text
    made = [read_record(folder) for folder in folders]
    assert swept(made) == ("nudge.share", [0.25, 1.0, 0.5])
    assert swept(made[:2]) is None

    def folded(folds: int) -> Provenance:
        return made[0].model_copy(update={"pipeline": {**made[0].pipeline, "folds": folds}})

    assert swept([folded(0), folded(3), folded(5)]) is None  # which change no surface
    assert swept([folded(5), *made[1:]]) is None


def test_pipeline_reads_back_as_it_was(run: Path) -> None:
    record = json.loads((run / "run.json").read_text())["pipeline"]
    read = tomllib.loads(as_toml(record))
    assert read["folds"] == 3
    assert [stage["use"] for stage in read["stage"]] == ["icp", "level_set"]
    odd: dict[str, Any] = {"use": "x", "as": 'a"b', "weights": {"L 1": 0.5}, "reject": ["mad"], "on": True}
    assert tomllib.loads(as_toml({"folds": 0, "stage": [{**odd, "none": None}]}))["stage"] == [odd]


def test_compare_puts_the_worst_first_and_links_reports(tmp_path: Path) -> None:
    worse = finished(tmp_path / "worse", bulged_case("worse", noise=1.0))
    better = finished(tmp_path / "better", bulged_case("better"))
    flat = finished_2d(tmp_path / "flat")
    quiet = finished(tmp_path / "<b>", renamed(bulged_case(points=70), "<b>bold</b>"))
    write_report([worse])
    text = compare([better, worse, flat, quiet], tmp_path / "page" / "all.html").read_text(encoding="utf-8")
    assert 'href="../worse/report.html"' in text
    assert "4 cases, 4 runs compared" in text
    assert "<b>bold" not in text
    assert "level_set closer in 3" in text
    assert "in px" in text.split("Judged by: held out")[-1]  # pixels are not averaged with millimetres


def test_verdict_compares_with_the_icp_among_those_shown(run: Path) -> None:
    subject = read_subject([run], ["start", "icp", "level_set"])
    assert subject.first is not None
    assert subject.first.name == "icp"
    alone = read_subject([run], ["level_set"])
    assert alone.shown == ["level_set"]
    assert alone.first is not None
    assert alone.first.name == "icp"


def test_estimates_may_start_at_none(tmp_path: Path) -> None:
    """A run of one stage is compared with where it began."""
    folder = Pipeline([LevelSet()], folds=0).run(bulged_case()).write(tmp_path / "run")
    assert read_subject([folder]).shown == ["start", "level_set"]
    folder = Pipeline([Icp()], folds=0).run(bulged_case()).write(tmp_path / "one")
    assert read_subject([folder]).shown == ["start", "icp"]


def test_fitted_ablation_points_count_wherever_fitted_points_do(tmp_path: Path) -> None:
    """The verdict says what the table says; what it is compared with is measured at the same points, shown to
    it or not.
    """
    case = replace(bulged_case(), truth=None)
    subject = read_subject([Pipeline([Icp(), ShownAblation()], folds=0).run(case).write(tmp_path / "run")])
    fitted = subject.last.scores["fitted"]
    found = headline_difference(subject)
    assert subject.headline == "fitted"
    assert found is not None
    assert found.n == fitted["n"] == 100
    assert found.second == pytest.approx(fitted["mean_mm"])
    spread = spread_section(subject)
    assert spread is not None
    assert "100 points" in spread.body
    case = replace(case, points=case.points.select(np.arange(103) >= 66))
    few = read_subject([Pipeline([Icp(), ShownAblation()], folds=0).run(case).write(tmp_path / "few")])
    assert Remark("Only 34 points were fitted.") in remarks(few)


class ShownAblation(LevelSet):
    @property
    def fits(self) -> tuple[str, ...]:
        return ("eam", "inside", "ablation")


def test_what_is_shown_differs_in_colour_and_dash(run: Path, tmp_path: Path) -> None:
    folders = [run, *(Path(shutil.copytree(run, tmp_path / name)) for name in ("b", "c", "d"))]
    subject = read_subject(folders)
    styles = {subject.style(name) for name in [*subject.shown, next(iter(subject.results))]}
    assert styles == set(range(5))  # and the last style is that of a calibrated posterior


def test_a_method_has_one_colour_in_report_slides_and_paper(run: Path) -> None:
    """Ours is blue and the ICP orange, whatever else is shown, in whatever order."""
    from o3dls.paper.drawing import COLOURS
    from o3dls.report.drawing.scene import scene

    for shown in ((), ("level_set", "icp"), ("start", "level_set")):
        subject = read_subject([run], shown)
        panels = {panel["name"]: panel["colour"] for panel in scene(subject)["estimates"]}
        for method, place in (("level_set", 0), ("icp", 1)):
            assert subject.style(method) == place
            assert panels.get(method, f"--s{place}") == f"--s{place}"
            assert LIGHT[place] == COLOURS[method]
    page = write_report([run]).read_text(encoding="utf-8")
    for k, (light, dark) in enumerate(zip(LIGHT, DARK, strict=True)):
        assert re.findall(rf"--s{k}: (#\w+)", page) == [light, dark]  # and nowhere else


def test_methods_that_share_a_colour_are_told_apart() -> None:
    assert places(["icp", "mine", "level_set"]) == [1, 2, 0]
    assert places(["level_set"] * 4 + ["icp"]) == [0, 2, 3, 4, 1]
    assert len(set(places([f"stage {k}" for k in range(9)]))) == 9


def test_distances_beyond_a_chart_are_counted_and_not_drawn() -> None:
    gaps = np.random.default_rng(SEED).exponential(size=800)
    x, share = cumulative(gaps, 2.0)
    assert x[-1] == 2.0
    assert (np.diff(share) >= 0).all()
    assert share[-1] == pytest.approx((gaps <= 2.0).mean(), abs=1 / MOST)
    edges, counts = histogram(gaps, 2.0)
    assert edges[-1] == 2.0
    assert counts[::2].sum() == (gaps <= 2.0).sum()
    assert (
        beyond({"icp": 3, "level_set": 0}, "2.00 mm")
        == '<p class="soft">Points farther than 2.00 mm, where the charts end: 3 of icp.</p>'
    )


def test_nothing_is_written_as_minus_zero() -> None:
    assert [signed(value) for value in (-0.004, 0.0, -0.006, 0.5)] == ["+0.00", "+0.00", "-0.01", "+0.50"]
    assert signed(-0.4, 0) == "+0"


def test_a_correction_has_a_name_and_a_unit() -> None:
    surface = replace(sphere(), fields={"correction_mm": sphere().vertices[:, 0]})
    assert [(field.label, field.unit) for field in known_fields([surface], "mm")] == [
        ("correction, outward positive", "mm")
    ]


@pytest.mark.parametrize(
    ("low", "high"), [(1.0, 30.0), (0.3, 4.0), (0.002, 0.19), (2.0, 300.0), (0.001, 1000.0)]
)
def test_ticks_of_a_logarithmic_axis_show_its_scale(low: float, high: float) -> None:
    ticks = Axis("x", low, high, log=True).ticks()
    assert 2 <= len(ticks) <= 7
    assert ticks == sorted(tick for tick in ticks if low <= tick <= high)


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (0.0, 0.037), (-13.0, 250.0), (0.0, 20000.0)])
def test_ticks_are_round_and_inside(low: float, high: float) -> None:
    ticks = Axis("x", low, high).ticks()
    assert 3 <= len(ticks) <= 7
    assert low - 1e-9 <= ticks[0]
    assert ticks[-1] <= high + 1e-9
    assert all(len(f"{tick:g}") <= 6 for tick in ticks)


def test_axis_of_nothing_is_still_an_axis() -> None:
    assert axis_over("x", []).high > axis_over("x", []).low
    assert axis_over("x", [np.full(3, 5.0)], log=True).low < 5.0


def test_gaps_break_a_line() -> None:
    x = np.arange(4.0)
    drawn = line_chart(
        "t", [Series("a", 0, x, np.array([0.0, 1.0, np.nan, 1.0]))], Axis("x", 0, 3), Axis("y", 0, 1)
    )
    path = re.search(r'<path d="([^"]+)" class="series s0 d0"></path>', drawn)
    assert path is not None
    assert path[1].count("M") == 2
