"""The page of a cohort: several runs of one case are one case, differences are paired within cases, an
interval that includes zero is called so, unlike results stay apart, and the worst stands first.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from pydantic import Field

from o3dls.case import Case
from o3dls.errors import InputError
from o3dls.estimate import Estimate
from o3dls.evaluation.statistics import Difference
from o3dls.pipeline.pipeline import Pipeline
from o3dls.report.checks import checks
from o3dls.report.cohort import cases
from o3dls.report.cohort.cases import Block, outcome
from o3dls.report.cohort.entries import Entry, read_entries, told_apart
from o3dls.report.cohort.page import cohort_page, summary
from o3dls.report.cohort.tables import Cell, sortable
from o3dls.report.grading.check import WORDS
from o3dls.report.sections.slides import graded
from o3dls.report.subject import read_subject
from o3dls.report.writer import compare
from tests.finished import NASTY, Icp, LevelSet, bulged_case, finished

SEED = 305_117
MOST_BYTES = 3_000_000  # of a page of a thousand cases
POSITIONS = np.random.default_rng(SEED).normal(size=(60, 3))
HOW_MADE = {"icp": {"icp.use": "icp"}, "level_set": {"icp.use": "icp", "level_set.use": "level_set"}}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(tmp_path_factory.mktemp("cohort") / "run")


def entry(case: str, name: str = "", *, key: str = "", unit: str = "mm", **means: float) -> Entry:
    """A run whose estimates have these mean distances at 60 points."""
    rng = np.random.default_rng([SEED, *name.encode()])
    spread = rng.uniform(-0.05, 0.05, (len(means), len(POSITIONS)))
    gaps = spread - spread.mean(axis=1, keepdims=True) + np.array(list(means.values()))[:, None]
    measured = {estimate: (POSITIONS, row) for estimate, row in zip(means, gaps, strict=True)}
    made = {estimate: HOW_MADE.get(estimate, {f"{estimate}.use": estimate}) for estimate in means}
    first, last = (*([None] if len(means) == 1 else []), *means)
    return Entry(
        Path(name or case), name or case, case, key or case, "held_out", unit, first, str(last),
        measured, made, True, 1.0, 0,
    )  # fmt: skip


def block(*entries: Entry) -> Block:
    return Block("held_out", "mm", entries)


class Tables(HTMLParser):
    """Text of the cells of every table, by its id."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: dict[str, list[list[str]]] = {}
        self.name, self.inside = "", False
        self.feed(page)

    def handle_starttag(self, name: str, attributes: list[tuple[str, str | None]]) -> None:
        if name == "table":
            self.name = dict(attributes)["id"] or ""
            self.found[self.name] = []
        if name == "tr":
            self.found[self.name].append([])
        if name in ("th", "td"):
            self.found[self.name][-1].append("")
            self.inside = True

    def handle_endtag(self, name: str) -> None:
        self.inside = self.inside and name not in ("th", "td")

    def handle_data(self, data: str) -> None:
        if self.inside:
            self.found[self.name][-1][-1] += data


def tables(entries: Sequence[Entry]) -> dict[str, list[list[str]]]:
    return Tables(cohort_page(entries, Path("all.html"))).found


THRICE = [
    entry("a", "a1", icp=2.0, level_set=1.0),
    entry("a", "a2", icp=2.0, level_set=1.2),
    entry("a", "a3", icp=2.0, level_set=1.4),
    entry("b", "b1", icp=3.0, level_set=2.0),
]


def test_a_case_that_was_run_three_times_is_one_case() -> None:
    page = cohort_page(THRICE, Path("all.html"))
    assert "<h1>2 cases, 4 runs compared</h1>" in page
    assert "Judged by: held out, in mm; 2 cases, 4 runs" in page
    found = Tables(page).found
    assert found["means-0"][1:] == [
        ["b", "1", "3.00", "2.00"],
        ["a", "3", "2.00 (2.00 to 2.00)", "1.20 (1.00 to 1.40)"],
    ]
    # cases count alike: (-0.8 - 1.0) / 2, where the four runs would give -0.85
    assert found["differences-0"][1][:3] == ["level_set − icp", "2", "-0.90"]
    assert [row[3] for row in found["cases-0"][1:]] == ["-1.00", "-0.80"]


def test_the_runs_of_a_real_case_are_known_by_its_prior_and_points(run: Path, tmp_path: Path) -> None:
    again = finished(tmp_path / "again", bulged_case("another name"))
    folders = [run, again, finished(tmp_path / "third", bulged_case(points=70))]
    page = compare(folders, tmp_path / "all.html").read_text(encoding="utf-8")
    assert "2 cases, 3 runs compared" in page
    # two cases of one name are told apart by a run
    assert {row[0] for row in Tables(page).found["means-0"][1:]} == {"ball (run)", "ball (third)"}


def test_an_interval_that_includes_zero_is_no_significant_difference() -> None:
    changes = [-0.5, 0.4, -0.3, 0.2]
    unsure = block(*(entry(f"c{k}", icp=2.0, level_set=2.0 + by) for k, by in enumerate(changes)))
    said = summary(unsure)
    assert "-0.05 mm on average over 4 cases" in said
    assert "mm: no significant difference. Case by case: icp closer in 2, level_set closer in 2." in said
    sure = block(*(entry(f"c{k}", icp=2.0, level_set=1.5 + by / 10) for k, by in enumerate(changes)))
    assert "mm: level_set closer. Case by case: level_set closer in 4." in summary(sure)
    farther = block(*(entry(f"c{k}", icp=2.0, level_set=2.5 + by / 10) for k, by in enumerate(changes)))
    assert "mm: icp closer." in summary(farther)


@pytest.mark.parametrize(
    ("mean", "low", "high", "said"),
    [
        (-0.4, -0.9, 0.1, "no significant difference"),
        (-0.4, -0.6, -0.2, "level_set closer"),
        (0.4, 0.2, 0.6, "icp closer"),
        (-0.002, -0.003, -0.001, "no significant difference"),  # the table would show zero
        (-0.4, np.nan, np.nan, "too few for an interval"),
    ],
)
def test_the_outcome_in_words(mean: float, low: float, high: float, said: str) -> None:
    assert outcome(Difference(2.0, 2.0 + mean, mean, low, high, 9, 9), ("icp", "level_set")) == said


def test_one_case_has_the_interval_of_its_own_points() -> None:
    said = summary(block(entry("a", icp=2.0, level_set=1.0)))
    assert re.search(
        r"-1\.00 mm in the one case .*interval -1\.\d\d to -0\.9\d mm: level_set closer\.$", said
    )
    found = tables([entry("a", icp=2.0, level_set=1.0)])
    assert set(found) == {"means-0", "cases-0", "runs-0", "metrics-0"}  # no table over cases


def test_one_estimate_alone_has_no_difference() -> None:
    alone = [entry("a", icp=2.0), entry("b", icp=3.0)]
    assert summary(block(*alone)) == "icp: mean distance 2.50 mm."
    assert set(tables(alone)) == {"means-0", "runs-0", "metrics-0"}


def test_millimetres_and_pixels_stand_apart() -> None:
    flat = replace(entry("flat", icp=4.0, level_set=3.0), unit="px")
    page = cohort_page([*THRICE, flat], Path("all.html"))
    assert "3 cases, 5 runs compared" in page
    assert "in px; 1 case, 1 run" in page
    assert [row[0] for row in Tables(page).found["means-1"][1:]] == ["flat"]


def test_the_worst_stands_first() -> None:
    means = {"c": 1.0, "a": 3.0, "b": 2.0}
    found = tables([entry(name, icp=4.0, level_set=mean) for name, mean in means.items()])
    for name in ("means-0", "cases-0", "runs-0"):
        assert [row[0] for row in found[name][1:]] == ["a", "b", "c"], name


class Shifted(LevelSet):
    """A result that depends on a number."""

    shift: float = Field(0.0, description="how far beside")

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        found = super().__call__(case, start)
        surface = found.surface.with_vertices(found.surface.vertices + self.shift)
        return replace(found, surface=surface)


def test_estimates_of_one_name_that_were_made_differently_are_never_averaged(tmp_path: Path) -> None:
    case = bulged_case()
    folders = [
        Pipeline([Icp(), Shifted(shift=shift)], folds=0).run(case).write(tmp_path / f"run{k}")
        for k, shift in enumerate([0.0, 1.0, 0.0])
    ]
    page = compare(folders, tmp_path / "all.html").read_text(encoding="utf-8")
    assert "1 case, 3 runs compared" in page
    assert "<strong>level_set (1)</strong>: level_set.shift = 0.0</li>" in page
    assert "<strong>level_set (2)</strong>: level_set.shift = 1.0</li>" in page
    head, row = Tables(page).found["means-0"]
    assert head[2:] == ["icp", "level_set (1)", "level_set (2)"]  # the ICP is the same in all runs
    assert row[1] == "3"
    assert "(" in row[2]
    assert "(" in row[3]  # of two runs
    assert "(" not in row[4]
    pairs = {line[1] for line in Tables(page).found["cases-0"][1:]}
    assert "level_set (2) − level_set (1)" in pairs
    assert "not adjusted for the number of comparisons" in page


def test_a_stage_that_one_case_does_not_allow_makes_no_other_estimate() -> None:
    with_marks = {"landmarks.use": "landmarks", "icp.use": "icp"}
    one = replace(entry("a", icp=2.0), made={"icp": with_marks})
    other = entry("b", icp=2.0)
    assert told_apart([one, other])[1] == {}
    same_case = replace(other, case_key="a")
    assert told_apart([one, same_case])[1] == {"icp (1)": "with landmarks", "icp (2)": "without landmarks"}


def test_of_many_estimates_each_is_compared_with_the_baseline() -> None:
    runs = [entry("a", f"r{k}", icp=2.0, **{f"result{k}": 1.0 + k}) for k in range(5)]
    pairs = {row[1] for row in tables(runs)["cases-0"][1:]}
    assert len(pairs) == 5
    assert all("icp" in pair for pair in pairs)


def test_estimates_at_other_points_are_not_paired() -> None:
    one = entry("a", icp=2.0, level_set=1.0)
    positions, gaps = one.measured["icp"]
    other = replace(one, measured={**one.measured, "icp": (positions[1:], gaps[1:])})
    assert block(other).cases[0].difference(("icp", "level_set")) is None
    assert "cases-0" not in tables([other])


def test_the_strip_plot_has_a_mark_per_case_and_a_line_between_its_estimates() -> None:
    page = cohort_page(THRICE, Path("all.html"))
    (plot,) = re.findall(r'<svg [^>]*class="chart strips".*?</svg>', page)
    assert len(re.findall("<circle", plot)) == 4  # two cases, two estimates; not four runs
    assert len(re.findall('<path d="M[^"]*L[^"]*" class="case better"', plot)) == 2
    assert len(re.findall('class="sign">▼</text>', plot)) == 2
    assert len(re.findall('class="series s[01]"', plot)) == 2  # the spread of the case of three runs
    assert "one mark per case" in plot
    assert "a, level_set: 1.20" in plot
    assert len(re.findall('class="mean"', plot)) == 2
    some = cohort_page([*THRICE, entry("c", icp=9.0)], Path("all.html"))
    assert len(re.findall('class="mean"', some)) == 1  # the result's mean would be one over other cases
    farther = cohort_page([entry("a", icp=1.0, level_set=2.0)], Path("all.html"))
    assert 'class="case worse"' in farther
    assert "<title>a: icp closer (+1.00 mm)</title>" in farther
    assert 'class="sign">▲</text>' in farther
    assert '<td class="text">▲ icp closer</td>' in farther
    equal = cohort_page([entry("a", icp=1.0, level_set=1.0)], Path("all.html"))
    assert 'class="case neither"' in equal
    assert 'class="sign">=</text>' in equal
    assert "= no significant difference</td>" in equal


def test_the_spread_of_runs_stays_within_the_plot() -> None:
    page = cohort_page([entry("a", "a1", icp=1.0), entry("a", "a2", icp=9.0)], Path("all.html"))
    (low, high) = re.findall(r'd="M[\d.]+ (-?[\d.]+)V(-?[\d.]+)" class="series', page)[0]
    assert 0 < float(high) < float(low) < 300  # the height of the drawing


def test_the_values_of_the_plot_are_a_table_for_screen_readers() -> None:
    page = cohort_page(THRICE, Path("all.html"))
    (values,) = re.findall('aria-details="([^"]+)"', page)
    assert Tables(page).found[values][1][2:] == ["3.00", "2.00"]
    for name in Tables(page).found:
        assert f'aria-labelledby="{name}-caption"' in page
        assert f'id="{name}-caption"' in page


def test_icp_and_ours_have_the_colours_of_the_report(run: Path, tmp_path: Path) -> None:
    subject = read_subject([run])
    page = compare([run], tmp_path / "all.html").read_text(encoding="utf-8")
    for name in ("icp", "level_set"):
        style = subject.style(name)
        assert re.search(rf'<title>ball, {name}: [^<]*</title><circle [^>]*class="f{style} dot"', page)


def test_what_failed_is_named_with_its_reason() -> None:
    failed = {"broken": "no prior surface", NASTY: "<b>"}
    page = cohort_page(THRICE, Path("all.html"), failed)
    assert "<h2>2 cases failed</h2>" in page
    assert "<li><strong>broken</strong>: no prior surface</li>" in page
    assert "<img src=x" not in page
    assert page.index("broken") < page.index("Judged by")
    assert "0 cases, 0 runs compared" in cohort_page([], Path("all.html"), failed)


def test_a_run_that_is_named_twice_is_refused(run: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the same run is named twice"):
        compare([run, run / ".." / "run"], tmp_path / "all.html")
    assert not (tmp_path / "all.html").exists()


def test_runs_are_called_by_as_much_of_their_path_as_tells_them_apart(run: Path, tmp_path: Path) -> None:
    folders = [Path(shutil.copytree(run, tmp_path / name / "run")) for name in ("x", "y")]
    assert [one.name for one in read_entries(folders)] == ["x/run", "y/run"]


def test_a_result_that_is_not_valid_is_counted() -> None:
    bad = replace(entry("a", icp=2.0, level_set=1.0), valid=False)
    assert summary(block(bad, entry("b", icp=2.0, level_set=1.0))).endswith(" 1 of 2 results not valid.")
    assert "no" in tables([bad])["runs-0"][1]


def test_a_run_without_points_to_judge_by_is_named() -> None:
    mute = replace(entry("c", "quiet", icp=2.0), group=None, measured={}, made={})
    page = cohort_page([*THRICE, mute], Path("all.html"))
    assert "Without points to judge by: quiet." in page
    assert "3 cases, 5 runs compared" in page


def test_the_page_of_a_thousand_cases_is_small(monkeypatch: pytest.MonkeyPatch) -> None:
    found = Difference(2.0, 1.5, -0.5, -0.6, -0.4, 60, 9)
    monkeypatch.setattr(cases, "paired_difference", lambda *_: found)  # whose resampling takes seconds
    many = [entry(f"case_{k:04d}_of_a_hospital", icp=2.0, level_set=1.0 + k / 1000) for k in range(1000)]
    failed = {f"broken_{k:04d}": "no prior surface; there must be a file prior.ply" for k in range(50)}
    page = cohort_page(many, Path("cohort.html"), failed)
    assert "1000 cases, 1000 runs compared" in page
    assert len(Tables(page).found["runs-0"]) == 1001
    assert len(page.encode()) < MOST_BYTES


def test_a_cell_without_a_number_is_ordered_last() -> None:
    text = sortable("t", "c", ["a", "b"], [[Cell("x"), Cell("–", np.nan)], [Cell("y"), Cell("1.00", 1.0)]], 1)
    assert '<td data-sort="">–</td>' in text
    assert '<td data-sort="1">1.00</td>' in text
    assert '<th scope="col" aria-sort="descending">b</th>' in text


def test_the_page_begins_with_the_grades_of_the_reports(run: Path, tmp_path: Path) -> None:
    """Each run has the word of its own report, and those that ask for a look are named with why."""
    (entry,) = read_entries([run])
    subject = read_subject([run])
    raised = [one for one in checks(subject) if one.grade in ("bad", "amber")]
    assert raised
    assert entry.grade == raised[0].grade
    fine = replace(entry, name="fine", case_key="other", grade="good", doubts=())
    page = cohort_page([fine, entry], tmp_path / "cohort.html")
    head, tables = page.split("<h2>", 1)
    assert f"1 {WORDS[entry.grade]}, 1 OK" in re.sub("<[^>]+>", "", head)
    assert f"{raised[0].name}: " in head
    cells = re.findall(r"<strong[^>]*>(CHECK|FAIL|OK)</strong>", tables)
    assert sorted(cells) == sorted([WORDS[entry.grade], "OK"])


def test_a_summary_for_slides_begins_with_the_grade(run: Path) -> None:
    subject = read_subject([run])
    raised = [one for one in checks(subject) if one.grade in ("bad", "amber")]
    assert graded(subject).startswith(f"{WORDS[raised[0].grade]}: {raised[0].name}: ")
