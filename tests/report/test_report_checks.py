"""The strip at the top of the page says what run.json says, grades it, and never by colour alone."""

from __future__ import annotations

import html
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.stats import norm

from o3dls.case import Points
from o3dls.evaluation.left_out import block_of
from o3dls.evaluation.regions import REGIONS
from o3dls.geometry.surface import Surface
from o3dls.report.checks import checks
from o3dls.report.expected import MEAN_OVER_SD, expected_error, left_out_scatter
from o3dls.report.grading import expected_error as grading
from o3dls.report.grading.check import WORDS, Check, count_decimals, write_share
from o3dls.report.grading.remarks import Remark
from o3dls.report.grading.wall import HALF
from o3dls.report.page import report_page
from o3dls.report.sections.outcome import overall, strip
from o3dls.report.subject import Subject, read_subject
from o3dls.run_warning import RunWarning
from tests.finished import bulged_case, finished, finished_2d


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(tmp_path_factory.mktemp("checks") / "run")


def edited(run: Path, folder: Path, estimate: str, **changes: dict[str, Any]) -> Path:
    """A copy of a run whose run.json says something else of one estimate."""
    copy = Path(shutil.copytree(run, folder))
    record = json.loads((copy / "run.json").read_text())
    for part, values in changes.items():
        record["estimates"][estimate][part] |= values
    (copy / "run.json").write_text(json.dumps(record))
    return copy


def removed(share: float, reach: float) -> dict[str, Any]:
    """What an estimate says whose stage took wall away."""
    return {"facts": {"removed_share": share, "removed_reach_mm": reach}}


def strip_of(folder: Path) -> dict[str, tuple[str, str, str]]:
    """Class, grade and text of each entry, as the page has them."""
    said = r'<span class="grade">([^<]+)</span><span>([^<]+)</span>(?:<small|</li)'
    found = re.findall(rf'<li class="(\w+)"><b>([^<]+)</b>{said}', report_page(read_subject([folder])))
    return {html.unescape(name): (kind, grade, html.unescape(said)) for kind, name, grade, said in found}


def test_the_strip_says_what_run_json_says(run: Path, tmp_path: Path) -> None:
    edited(run, tmp_path / "a", "icp", facts={"outlier_fraction": 0.061})
    record = json.loads((tmp_path / "a" / "run.json").read_text())
    found = strip_of(tmp_path / "a")
    last = record["estimates"][record["final"]]
    assert found["Valid surface"][0] == ("good" if record["valid"] else "bad")
    not_yet = [
        f"{name} ({one['status']})" for name, one in record["estimates"].items() if not one["converged"]
    ]
    assert found["Converged"] == ("amber", "CHECK", f"not converged: {'; '.join(not_yet)}")
    assert found["Share of outliers"][2] == "6% of the points"
    change = 100 * last["validity"]["volume_change"]
    normal = "; a healthy atrium empties by about 55% of its largest volume in a beat: "
    normal += "a heart phase can explain it"
    normal += f"; {1 - read_subject([tmp_path / 'a']).unmapped:.0%} of the wall has points that show it"
    assert found["Volume change"] == ("good", "OK", f"{change:+.0f} % against the prior{normal}")
    for kind, grade, said in found.values():
        assert grade == WORDS[kind]  # type: ignore[index]
        assert said


@pytest.mark.parametrize(
    ("name", "estimate", "changes", "grade", "said"),
    [
        ("Valid surface", "level_set", {"validity": {"components": 2}}, "bad", "surface has 2 components"),
        ("Volume change", "level_set", {"validity": {"volume_change": -0.34}}, "good", "can explain it"),
        ("Volume change", "level_set", {"validity": {"volume_change": 0.51}}, "amber", "alone is unlikely"),
        ("Removed wall", "icp", removed(0.004, 4.0), "good", "0.4%"),
        ("Removed wall", "icp", removed(0.006, 4.0), "amber", "0.6%"),
        ("Volume change", "level_set", {"validity": {"volume_change": None}}, "none", "open"),
        ("Share of outliers", "icp", {"facts": {"outlier_fraction": 0.3}}, "amber", "30%"),
    ],
)  # fmt: skip
def test_what_must_be_looked_at_is_amber_or_red(
    run: Path, tmp_path: Path, name: str, estimate: str, changes: dict[str, Any], grade: str, said: str
) -> None:
    kind, word, text = strip_of(edited(run, tmp_path / "b", estimate, **changes))[name]
    assert (kind, word) == (grade, WORDS[grade])  # type: ignore[index]
    assert said in text


def test_wall_that_a_template_lost_is_said_and_is_no_doubt(run: Path, tmp_path: Path) -> None:
    subject = read_subject([edited(run, tmp_path / "b", "icp", **removed(0.06, 12.0))])
    found = {}
    for whose in ("patient", "template"):
        runs = [replace(one, case=replace(one.case, prior_of=whose)) for one in subject.runs]
        of_it = {name: replace(one, run=runs[0]) for name, one in subject.results.items()}
        checked = checks(replace(subject, runs=runs, results=of_it))
        found[whose] = next(one for one in checked if one.name == "Removed wall")
    assert [one.grade for one in found.values()] == ["amber", "good"]
    assert "6.0% of the wall was removed, up to 12 mm" in found["template"].said


def test_an_earlier_stage_that_did_not_converge_is_amber(run: Path, tmp_path: Path) -> None:
    copy = edited(run, tmp_path / "c", "icp")
    record = json.loads((copy / "run.json").read_text())
    record["estimates"]["icp"]["converged"] = False
    record["estimates"]["level_set"]["converged"] = True
    (copy / "run.json").write_text(json.dumps(record))
    assert strip_of(copy)["Converged"] == (
        "amber",
        "CHECK",
        "not converged: icp (converged: the pairs no longer change)",
    )


def with_sd(subject: Subject, sd: float) -> Subject:
    """The subject with one posterior deviation everywhere on the last surface."""
    last, run = subject.last, subject.last.run
    surface: Surface = last.estimate.surface
    surface = replace(surface, fields={**surface.fields, "sd_mm": np.full(len(surface.vertices), sd)})
    changed = replace(run, estimates={**run.estimates, last.key: replace(last.estimate, surface=surface)})
    results = {name: replace(one, run=changed) for name, one in subject.results.items()}
    return replace(subject, results=results, runs=[changed])


def test_calibration_that_is_off_is_amber(run: Path) -> None:
    """The surface lies on the truth: a large deviation is too cautious; a small one beside it, confident."""
    subject = read_subject([run])
    cautious = next(one for one in checks(with_sd(subject, 5.0)) if one.name == "Calibration")
    assert (cautious.grade, "100%" in cautious.said, "too cautious" in cautious.said) == ("amber", True, True)
    beside = read_subject([run], ["level_set", "icp"])
    confident = next(one for one in checks(with_sd(beside, 0.01)) if one.name == "Calibration")
    assert confident.grade == "amber"
    assert "within the 68% band of the truth: too confident" in confident.said


def test_the_expected_error_is_that_of_a_normal_posterior(run: Path) -> None:
    found = expected_error(with_sd(read_subject([run]), 2.0))
    assert found is not None
    assert found.all == pytest.approx(2.0 * MEAN_OVER_SD)
    said = next(one.said for one in checks(with_sd(read_subject([run]), 2.0)) if one.name == "Expected error")
    assert "mean 1.60 mm" in said
    assert "mapped wall: 1.60 mm" in said
    assert expected_error(read_subject([run], ["icp"])) is None


def test_doubt_about_existence_is_no_part_of_the_expected_error(run: Path) -> None:
    subject = with_sd(read_subject([run]), 2.0)
    surface = subject.last.estimate.surface
    count = len(surface.vertices)
    fields = {"existence": np.full(count, 0.75), "distance_to_nearest_point_mm": np.full(count, 12.0)}
    doubted = of_run(
        subject, **{subject.last.key: {"surface": replace(surface, fields=surface.fields | fields)}}
    )
    assert "mean 1.60 mm" in doubted["Expected error"].said
    assert "25.0% of the surface may not exist" in doubted["Prior-only area"].said


def check_of(subject: Subject, name: str) -> Check:
    return next(one for one in checks(subject) if one.name == name)


def with_left_out(subject: Subject, distance: float, deviation: float) -> Subject:
    """The subject whose mapping points all lay so far from fits without them, of this predicted deviation."""
    last, points = subject.last, subject.last.run.points
    eam = points.type == "eam"
    columns = {
        f"left_out_{last.key}_mm": np.where(eam, distance, np.nan),
        f"left_out_sd_{last.key}_mm": np.where(eam, deviation, np.nan),
    }
    run = replace(last.run, points=replace(points, columns={**points.columns, **columns}))
    results = {name: replace(one, run=run) for name, one in subject.results.items()}
    return replace(subject, results=results, runs=[run])


def test_the_posterior_alone_is_never_ok(run: Path) -> None:
    found = check_of(with_sd(read_subject([run]), 2.0), "Expected error")
    assert found.grade == "none"
    assert "not cross-validated" in found.said


@pytest.mark.parametrize(
    ("distance", "grade", "mapped"), [(1.0, "good", 2.0), (3.0, "good", 3.0), (8.0, "amber", 8.0)]
)
def test_left_out_points_confirm_the_posterior_or_contradict_it(
    run: Path, distance: float, grade: str, mapped: float
) -> None:
    subject = with_left_out(with_sd(read_subject([run]), 2.0), distance, 2.5)
    check, found = check_of(subject, "Expected error"), expected_error(subject)
    assert check.grade == grade
    assert f"lie {distance / 2.5:.2f} times as far off as predicted" in check.said
    assert found is not None
    factor = max(1.0, distance / 2.5)
    assert found.mapped == pytest.approx(2.0 * factor * MEAN_OVER_SD)
    assert found.prior_only is None or found.prior_only == pytest.approx(2.0 * MEAN_OVER_SD)


def test_points_that_do_not_touch_the_wall_say_nothing_of_it(run: Path) -> None:
    subject = with_left_out(with_sd(read_subject([run]), 2.0), 1.0, 1.0)
    last, points = subject.last, subject.last.run.points
    fitted = np.isin(points.type, last.fitted)
    believed = np.ones(int(fitted.sum()))
    believed[:10] = 0.0
    points.columns[f"left_out_{last.key}_mm"][np.flatnonzero(fitted)[:10]] = 100.0
    estimates = {**last.run.estimates, last.key: replace(last.estimate, weights=believed)}
    found = left_out_scatter(replace(last, run=replace(last.run, estimates=estimates)))
    assert found is not None
    assert found.ratio == pytest.approx(1.0)


@pytest.mark.parametrize(("few", "named"), [(9, False), (10, True)])
def test_a_region_whose_points_contradict_the_posterior_is_named(
    run: Path, monkeypatch: pytest.MonkeyPatch, few: int, named: bool
) -> None:
    subject = with_left_out(with_sd(read_subject([run]), 2.0), 1.0, 2.0)
    points, surface = subject.last.run.points, subject.last.estimate.surface
    eam = np.flatnonzero(points.type == "eam")
    nearest = cKDTree(surface.vertices).query(points.xyz[eam])[1]
    vertices, first, count = np.unique(nearest, return_index=True, return_counts=True)
    alone = np.flatnonzero(count == 1)[:few]  # vertices with one point each
    points.columns[f"left_out_{subject.last.key}_mm"][eam[first[alone]]] = 8.0
    of = np.zeros(len(surface.vertices), dtype=np.int64)
    of[vertices[alone]] = REGIONS.index("RIPV")
    monkeypatch.setattr(grading, "wall_regions", lambda *_: of)
    found = check_of(subject, "Expected error")
    assert ("do not rely on it at ostium RIPV" in found.said) == named
    assert (found.grade == "amber") == named


def test_points_that_were_left_out_together_are_one_witness(run: Path) -> None:
    """Three times as far off as predicted is one chance in 370 for a block, and less for several."""
    subject = with_left_out(with_sd(read_subject([run]), 2.0), 6.0, 2.0)
    last = subject.last
    block = block_of(last.run.case.points.of("eam").xyz, 1)
    together, apart = block == 0, np.ones(len(block), dtype=bool)
    one, three = left_out_scatter(last, together), left_out_scatter(last, apart)
    assert one is not None
    assert three is not None
    assert (one.ratio, three.ratio) == pytest.approx((3.0, 3.0))
    assert one.count > grading.FEWEST
    assert one.chance == pytest.approx(2.0 * norm.sf(3.0))
    assert three.chance < grading.UNLIKELY < one.chance


def test_in_2d_areas_are_compared_and_parts_of_a_wall_are_not(tmp_path: Path) -> None:
    found = strip_of(finished_2d(tmp_path / "flat"))
    assert "Area change" in found
    assert {found[name][0] for name in ("Farthest part", "Prior-only area")} == {"none"}


def of_run(subject: Subject, **estimates: Any) -> dict[str, Check]:
    """The checks by name, with some attributes of estimates changed."""
    run = subject.last.run
    changed = {name: replace(one, **estimates.get(name, {})) for name, one in run.estimates.items()}
    found = replace(run, estimates=changed)
    results = {name: replace(one, run=found) for name, one in subject.results.items()}
    return {one.name: one for one in checks(replace(subject, results=results, runs=[found]))}


@pytest.mark.parametrize(
    ("code", "grade"), [("duplicate-points", "good"), ("map-shift", "amber"), ("many-outliers", "bad")]
)
def test_the_verdict_is_never_better_than_the_gravest_warning(run: Path, code: str, grade: str) -> None:
    said = (RunWarning("duplicate-points", "twice"), RunWarning(code, "said"))
    found = of_run(read_subject([run]), icp={"warnings": said})
    assert found["Warnings"].grade == grade
    assert ("said" in found["Warnings"].said) == (grade != "good")
    if grade != "good":
        assert WORDS[found["Warnings"].grade] in str(overall([*found.values()], [Remark("said")]))


@pytest.mark.parametrize(("step", "grade"), [(0.01, "good"), (0.3, "amber"), (None, "amber")])
def test_convergence_is_judged_by_the_step_that_is_left_against_the_noise(
    run: Path, step: float | None, grade: str
) -> None:
    """Also of a later stage that leaves the motion alone."""
    facts = {} if step is None else {"last_step": step}
    still = {"icp": {"converged": False, "sigma": 1.5, "facts": facts}, "level_set": {"converged": False}}
    assert of_run(read_subject([run]), **still)["Converged"].grade == grade


@pytest.mark.parametrize(
    ("prior_of", "off", "grade"),
    [
        ("patient", 4.0, "good"),
        ("patient", 6.0, "amber"),
        ("template", 6.0, "good"),
        ("template", 16.0, "amber"),
    ],
)
def test_landmarks_of_another_person_may_all_lie_off(
    run: Path, prior_of: str, off: float, grade: str
) -> None:
    subject = read_subject([run])
    last = subject.last
    gap = np.full(4, off)
    names = {"name": np.array(["RSPV", "RIPV", "LSPV", "LIPV"]), f"distance_{last.key}_mm": gap}
    marked = replace(last.run, points=Points(np.zeros((4, 3)), np.full(4, "landmark"), names))
    marked = replace(marked, case=replace(marked.case, prior_of=prior_of))
    results = {name: replace(one, run=marked) for name, one in subject.results.items()}
    found = {one.name: one for one in checks(replace(subject, results=results, runs=[marked]))}
    assert found["Landmarks"].grade == grade


@pytest.mark.parametrize(("far", "grade"), [(24.0, "good"), (26.0, "amber")])
def test_a_connected_part_that_reaches_far_from_all_points_is_looked_at(
    run: Path, far: float, grade: str
) -> None:
    subject = read_subject([run])
    surface = subject.last.estimate.surface
    gap = np.where(surface.vertices[:, 2] > np.quantile(surface.vertices[:, 2], 0.6), far, 3.0)
    fields = {**surface.fields, "distance_to_nearest_point_mm": gap}
    last = {subject.last.key: {"surface": replace(surface, fields=fields)}}
    found = of_run(subject, **last)["Farthest part"]
    assert found.grade == grade
    assert ("mm from the nearest" in found.said) == (grade == "amber")


def scaled(subject: Subject, scale: float) -> Subject:
    """The subject whose ICP makes the prior so many times as large."""
    run = subject.last.run
    pose = np.diag([scale, scale, scale, 1.0])
    run = replace(run, estimates=run.estimates | {"icp": replace(run.estimates["icp"], T_map_prior=pose)})
    results = {name: replace(one, run=run) for name, one in subject.results.items()}
    return replace(subject, results=results, runs=[run])


@pytest.mark.parametrize(
    ("scale", "short", "limit"),
    [
        (0.876, "x 0.876", "from x 0.878 to x 1.139"),
        (0.87, "x 0.87", "from x 0.88 to x 1.14"),
        (1.14, "x 1.140", "from x 0.878 to x 1.139"),
    ],
)
def test_a_size_that_fails_does_not_look_equal_to_its_limit(
    run: Path, scale: float, short: str, limit: str
) -> None:
    found = check_of(scaled(read_subject([run]), scale), "Size")
    assert (found.grade, found.short, found.limit) == ("amber", short, limit)


def test_a_value_and_a_limit_that_differ_are_written_so() -> None:
    assert [count_decimals(one, (50.0,), 0) for one in (50.0, 49.0, 50.4, 49.96, 50.0001)] == [0, 0, 1, 2, 3]
    assert [write_share(one, 0.2) for one in (0.2, 0.19, 0.204)] == ["20%", "19%", "20.4%"]


@pytest.mark.parametrize(("fraction", "share"), [(0.203, "20.3%"), (0.3, "30%")])
def test_a_share_that_fails_does_not_look_equal_to_its_limit(
    run: Path, tmp_path: Path, fraction: float, share: str
) -> None:
    copy = edited(run, tmp_path / "d", "icp", facts={"outlier_fraction": fraction})
    found = check_of(read_subject([copy]), "Share of outliers")
    assert (found.grade, found.short) == ("amber", share)


@pytest.mark.parametrize(
    ("scale", "told"), [(0.87, "; a beat: 55%)"), (0.87, "(size alone: -34 %; "), (1.01, " % (a beat: 55%)")]
)
def test_the_volume_says_what_of_its_change_is_the_size(
    run: Path, tmp_path: Path, scale: float, told: str
) -> None:
    copy = edited(run, tmp_path / "e", "level_set", validity={"volume_change": -0.35})
    assert told in check_of(scaled(read_subject([copy]), scale), "Volume change").short


def test_without_truth_calibration_is_no_entry(tmp_path: Path) -> None:
    case = replace(bulged_case(), truth=None)
    assert "Calibration" not in strip_of(finished(tmp_path / "run", case))


def test_each_graded_entry_says_what_is_ok_and_each_other_why_it_has_no_grade(run: Path) -> None:
    subject = read_subject([run])
    for one in checks(subject):
        assert bool(one.limit) == (one.grade != "none"), one
        assert one.short, one
    shown = str(strip(checks(subject), "surface"))
    assert f"OK up to {HALF:.0%}</small>" in shown
    assert "OK from 48% to 88%</small>" in shown


def test_the_overall_grade_is_the_worst_and_ok_says_what_it_rests_on() -> None:
    ok, none = Check("a", "good", "fine"), Check("b", "none", "no points")
    amber, red = Check("c", "amber", "far off", "9 mm"), Check("d", "bad", "not valid: a fold")
    assert "OK</strong> No check found a problem: 2 checks passed, 1 without data. </p>" in overall(
        [ok, none, ok], []
    )
    assert "CHECK</strong> Look at this before you use the surface: c: 9 mm. </p>" in overall(
        [ok, amber, none], []
    )
    limited = replace(amber, limit="up to 5 mm")
    assert "surface: c: 9 mm (OK up to 5 mm). </p>" in overall([ok, limited], [])
    said = overall([amber, red], [])
    assert "FAIL</strong> Do not use the surface before you know why: d: not valid: a fold; c: 9 mm. " in said


def test_remarks_at_the_top_are_whole_and_a_link_leads_to_the_others() -> None:
    few, long = Remark("Only 3 points were fitted.", "amber"), Remark("x " * 100 + "end", "amber")
    note = Remark("The image has no spacing")
    assert "2 warnings, 1 note: Only 3 points were fitted. " in overall([], [few, long, note])
    assert overall([], [few, long, note]).endswith('<a href="#warnings">And 2 more</a>.</span></p>')
    assert "x x end. <a" in overall([], [long, few])  # whole, however long it is
    assert "1 note: The image has no spacing. </span>" in overall([], [note])
    shown = overall([], [few, replace(few, sentence="Nothing else"), note])
    assert "Only 3 points were fitted. Nothing else. " in shown
    assert "And 1 more" in shown
