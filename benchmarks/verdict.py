"""The verdict as a classifier: python -m benchmarks.verdict FOLDER... --records FILE

    python -m benchmarks.cases altered cases/dev --data ../shared/data
    python -m benchmarks.verdict cases/dev --records dev.jsonl --runs runs/dev      every case, one line each
    python -m benchmarks.verdict cases/dev --records dev.jsonl --peers poisson      and a peer's error
    python -m benchmarks.verdict --table dev.jsonl --csv dev.csv
    python -m benchmarks.verdict --again runs/dev --records dev.jsonl --out new.jsonl
    python -m benchmarks.verdict --separation dev.jsonl    which statistics tell bad results from good ones

Each case is run as `o3dls run --case` runs it, without folds unless asked for, and graded as a user sees it
who has no truth: truth, held-out points and correspondence are hidden from the run. With `--runs` the run
folders stay, and `--again` grades them anew, without fitting, when the checks have changed; warnings are
those of the fit. A line has the grade, every check and warning, the expected error, the raw statistics that a
check could use (benchmarks.verdict_statistics) and the true errors of every estimate.

A result is bad where its true mean error, both directions, is above twice the error that its headline
expects, or above 1.2 times that of the best tuned peer. The table says how well grade, checks and warnings
tell bad results from good ones. AUC: how often a bad result has the worse grade of a bad and a good one, ties
half. What was refused has no result, and is counted apart.

The separation has, of every number in the records and of some ratios of them: its AUC (`-` where bad results
have the lower value), the rank correlation with the true error, and the threshold above (below) which 5 % and
10 % of the good lie, with the share of the bad that it catches there.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np

from benchmarks.bands import bands
from benchmarks.cases import Listed, find, tuned_as
from benchmarks.peers import FAILURES, PEERS, applicable, tuned
from benchmarks.scores import Record, lay_out, on_wall, truth_distances
from benchmarks.verdict_statistics import statistics
from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.evaluation.distances import distances, sample
from o3dls.evaluation.interpolation import REACH
from o3dls.geometry.surface import Surface
from o3dls.pipeline.workers import workers

SAMPLES = 8000
SLOW = {"pycpd": 1200, "nricp_sumner": 1200}  # points, above which a peer is left out
TUNED_POINTS = (100, 250, 1000, 4000, 20_000)  # of the crossed atria, on which all peers are tuned
GRADES = {"good": 0, "amber": 1, "bad": 2}
WORDS = {"good": "OK", "amber": "CHECK", "bad": "FAIL"}
OF_HEADLINE, OF_PEERS = 2.0, 1.2
FALSE_ALARMS = (0.05, 0.10)  # of the good: how many false alarms a threshold may give
RATIOS = (  # what means more over something else than alone
    ("resid_final_mean", "resid_icp_mean"),
    ("resid_final_q95", "final_sigma"),
    ("resid_final_q50", "final_sigma"),
    ("left_1_mm", "final_sigma"),
    ("left_8_mm", "final_sigma"),
    ("left_16_mm", "final_sigma"),
    ("left_16_worst_mm", "left_16_mm"),
    ("apart_icp_final", "sd_mean"),
    ("apart_deform_final", "sd_mean"),
    ("moved_rms", "sd_mean"),
    ("marks_final_rms", "deform_landmark_noise"),
    ("ablation_final", "ablation_icp"),
    ("final_area", "start_area"),
    ("deform_area", "start_area"),
    ("far_reach", "gap_mean"),
    ("deform_last_step", "deform_sigma"),
    ("deform_energy", "points"),
    ("deform_misfit", "points"),
    ("deform_complexity", "points"),
)


def judged(listed: Listed, folds: int = 0, keep: Path | None = None) -> Record:
    """The record of one case, run and graded without its truth; a case that is refused says why."""
    from o3dls.errors import O3dlsError
    from o3dls.pipeline.file import default_pipeline

    case = listed.read()
    about = {"group": listed.group, "case": listed.name, "points": int((case.points.type == "eam").sum())}
    hidden = replace(case, truth=None)
    begin = perf_counter()
    try:
        plan = replace(default_pipeline().allowed_by(hidden), writes=(), folds=folds)
        run = plan.run(hidden)
    except O3dlsError as error:
        return {**about, "error": str(error), "seconds": perf_counter() - begin}
    seconds = {"seconds": perf_counter() - begin}
    with TemporaryDirectory() as temporary:
        folder = run.write((keep or Path(temporary)) / listed.name, force=True)
        graded = grading(folder)
        by_region = region_errors(case, folder)
    known = {"regions": by_region, "bands": bands(case, run.estimates[graded["final"]])}
    truth = {"truth": true_errors(case, run.estimates) | known}
    return {**about, **graded, **seconds, "stats": statistics(run), **truth}


def grading(folder: Path) -> Record:
    """What a user is told of a finished run: grade, checks, warnings, expected error."""
    from o3dls.cli.summary import summary
    from o3dls.report.checks import checks
    from o3dls.report.expected import expected_error
    from o3dls.report.grading.doubts import doubted_regions
    from o3dls.report.subject import read_subject
    from o3dls.run_warning import each_once

    subject = read_subject([folder])
    found = checks(subject)
    warned = each_once(one for e in subject.last.run.estimates.values() for one in e.warnings)
    expected = expected_error(subject)
    return {
        "grade": summary(folder).grade,
        "final": subject.last.key,
        "checks": [{"name": one.name, "grade": one.grade, "said": one.said} for one in found],
        "doubts": [
            {"name": one.region or one.name, "said": one.said} for one in doubted_regions(subject, found)
        ],
        "warnings": [warning.record() for warning in warned],
        "headline": None if expected is None else vars(expected),
        "validity": dict(subject.last.validity),
    }


def region_errors(case: Case, folder: Path) -> dict[str, float]:
    """Mean distance of each region of a run's last surface from the true one, by its name; empty where the
    regions are not known.
    """
    from o3dls.evaluation.regions import word
    from o3dls.report.mapping.wall_regions import wall_regions
    from o3dls.report.subject import read_subject

    assert case.truth is not None
    assert case.truth.surface is not None
    subject = read_subject([folder])
    surface = subject.last.estimate.surface
    of = wall_regions(subject, surface)
    if of is None:
        return {}
    gap, area = distances(surface.vertices, case.truth.surface), surface.vertex_areas
    return {word(int(k)): float(area[of == k] @ gap[of == k] / area[of == k].sum()) for k in np.unique(of)}


def graded_again(record: Record, runs: Path) -> Record:
    """The record with what the checks say now of the run that was kept, and with statistics that are new."""
    from o3dls.runs.folder import read_run

    folder = runs / record["case"]
    if "error" in record or not folder.is_dir():
        return record
    stats = record["stats"] | statistics(read_run(folder))
    return record | grading(folder) | {"stats": stats}


def compared(listed: Listed, records: dict[str, Record], names: list[str]) -> Record:
    """The mean errors of some peers on a case, from the pose of its ICP."""
    pose = records[listed.name]["stats"]["icp_pose"]
    return {"case": listed.name, "peers": peers_errors(listed, pose, names)}


def read_records(path: Path | None) -> dict[str, Record]:
    """Records by case: lines of one case are joined, and so are their peers."""
    found: dict[str, Record] = {}
    lines = path.read_text().splitlines() if path and path.is_file() else []
    for record in map(json.loads, lines):
        before = found.get(record["case"], {})
        peers = before.get("peers", {}) | record.get("peers", {})
        found[record["case"]] = before | record | ({"peers": peers} if peers else {})
    return found


def _append_records(path: Path | None, records: Iterable[Record]) -> None:
    """Append each record as it comes, and say so."""
    for record in records:
        said = record.get("error") or record.get("grade") or record.get("peers")
        print(f"{record['case']}: {said}", file=sys.stderr, flush=True)
        if path:
            with path.open("a") as file:
                file.write(json.dumps(record) + "\n")


def true_errors(case: Case, estimates: Mapping[str, Estimate]) -> Record:
    """Mean errors of every estimate (mm, see `errors_of`), the noise of points that truly touch the wall (rms
    distance), and the share of the mapping points that do not.
    """
    assert case.truth is not None
    assert case.truth.surface is not None
    touching = case.points.xyz[on_wall(case)]
    noise = np.sqrt((distances(touching, case.truth.surface) ** 2).mean())
    outliers = 1.0 - len(touching) / max(1, int((case.points.type == "eam").sum()))
    errors = {name: errors_of(case, estimate.surface) for name, estimate in estimates.items()}
    return {"errors": errors, "noise": float(noise), "outlier_fraction": float(outliers)}


def errors_of(case: Case, surface: Surface) -> dict[str, float]:
    """Mean distances: `t2s` truth to surface, `s2t` back, `ssd` of both, `hd95`; `mapped` and `unmapped` are
    both directions on what lies within 10 mm of a mapping point, and on the rest.
    """
    assert case.truth is not None
    assert case.truth.surface is not None
    there, back = truth_distances(case, surface, SAMPLES)
    found = {"t2s": there.mean(), "s2t": back.mean(), "ssd": 0.5 * (there.mean() + back.mean())}
    found["hd95"] = max(np.percentile(there, 95.0), np.percentile(back, 95.0))
    sides = [
        _split_by_points(case, case.truth.surface, surface),
        _split_by_points(case, surface, case.truth.surface),
    ]
    for name, part in zip(("mapped", "unmapped"), zip(*sides, strict=True), strict=True):
        if all(len(gaps) for gaps in part):
            found[name] = np.mean([gaps.mean() for gaps in part])
    return {name: float(value) for name, value in found.items()}


def _split_by_points(case: Case, source: Surface, target: Surface) -> tuple[Array, Array]:
    """Distances of samples of one surface from another: near mapping points, and far from all."""
    from scipy.spatial import cKDTree

    at = sample(source, SAMPLES)
    gap = distances(at, target)
    near = cKDTree(case.points.of("eam").xyz).query(at)[0] <= REACH
    return gap[near], gap[~near]


def peers_errors(listed: Listed, pose: list[list[float]], names: list[str]) -> dict[str, float]:
    """Mean error (both directions) of the named peers as tuned for the group, or else for crossed atria of as
    many points; from a pose.
    """
    case = listed.read()
    settings = tuned().get(tuned_as(listed.group)) or tuned()[_find_like(case)]
    found = {}
    for name in applicable(case):
        if name not in {*names} & settings.keys() or len(case.points.of("eam")) > SLOW.get(name, np.inf):
            continue
        try:
            surface = PEERS[name](case.visible(), np.array(pose), **settings[name]["parameters"])
        except FAILURES as error:
            print(f"{case.name}: {name} failed: {error}", file=sys.stderr)
            continue
        found[name] = errors_of(case, surface)["ssd"]
    return found


def _find_like(case: Case) -> str:
    """The crossed atria with the nearest number of points."""
    n = max(1, len(case.points.of("eam")))
    return f"cross_{min(TUNED_POINTS, key=lambda other: abs(np.log(other / n)))}"


def true_error(record: Record) -> float:
    """Mean error of the final estimate, both directions."""
    return float(record["truth"]["errors"][record["final"]]["ssd"])


def best_peer(record: Record) -> float | None:
    """The error of the peer that came nearest; None where none ran."""
    return min(record.get("peers", {}).values(), default=None)


def reasons(record: Record) -> list[str]:
    """Why a result is bad; empty where it is good."""
    error, peer = true_error(record), best_peer(record)
    expected = (record.get("headline") or {}).get("all")
    found = ["headline"] if expected is not None and error > OF_HEADLINE * expected else []
    return found + ["peer"] * (peer is not None and error > OF_PEERS * peer)


def auc(bad: Sequence[float] | Array, good: Sequence[float] | Array) -> float:
    """Share of pairs in which the bad one has the higher value, ties half; NaN where a side is empty."""
    one, other = np.asarray(bad, dtype=float)[:, None], np.asarray(good, dtype=float)[None]
    return float(((one > other) + 0.5 * (one == other)).mean()) if one.size and other.size else float("nan")


def rank_correlation(a: Sequence[float], b: Sequence[float]) -> float:
    """Spearman's; NaN where one side is all alike, or there are fewer than three."""
    from scipy.stats import rankdata

    ranks = rankdata(a), rankdata(b)
    if len(ranks[0]) < 3 or any(np.ptp(side) == 0 for side in ranks):
        return float("nan")
    return float(np.corrcoef(*ranks)[0, 1])


def table(records: Iterable[Record]) -> str:
    """All tables: by group and over all, by check, by warning."""
    every = list(records)
    done = [record for record in every if "grade" in record]
    refused = [record["case"] for record in every if "error" in record]
    parts = [_tabulate_groups(done), _tabulate_checks(done), _tabulate_warnings(done)]
    if refused:
        parts.append(f"refused ({len(refused)}): " + ", ".join(refused))
    return "\n\n".join(parts)


def _tabulate_groups(records: list[Record]) -> str:
    groups = {record["group"]: [r for r in records if r["group"] == record["group"]] for record in records}
    head = ["group", "n", "bad", "OK/CHECK/FAIL of bad", "of good", "AUC", "rank", "true/expected"]
    rows = [[group, *_judge_group(own)] for group, own in groups.items()]
    return lay_out([head, *rows, ["all", *_judge_group(records)]])


def _judge_group(records: list[Record]) -> list[str]:
    bad, good = _part_bad_from_good(records)
    errors = [true_error(record) for record in records]
    ratios = [e / r["headline"]["all"] for e, r in zip(errors, records, strict=True) if r.get("headline")]
    levels = [[GRADES[record["grade"]] for record in side] for side in (bad, good)]
    return [
        str(len(records)),
        str(len(bad)),
        _count_grades(bad),
        _count_grades(good),
        f"{auc(*levels):.2f}",
        f"{rank_correlation([GRADES[r['grade']] for r in records], errors):.2f}",
        f"{np.median(ratios):.2f} ({np.max(ratios):.1f})" if ratios else "",
    ]


def _part_bad_from_good(records: list[Record]) -> tuple[list[Record], list[Record]]:
    """The bad ones and the good ones."""
    return [r for r in records if reasons(r)], [r for r in records if not reasons(r)]


def _count_grades(records: list[Record]) -> str:
    return "/".join(str(sum(r["grade"] == grade for r in records)) for grade in GRADES)


def _tabulate_checks(records: list[Record]) -> str:
    """How often each check was not OK, on bad and on good results."""
    said = {
        f"{check['name']}: {WORDS[check['grade']]}"
        for record in records
        for check in record["checks"]
        if check["grade"] in ("amber", "bad")
    }
    return _count_said(
        "check",
        records,
        {
            name: [
                any(f"{c['name']}: {WORDS.get(c['grade'], '')}" == name for c in r["checks"]) for r in records
            ]
            for name in said
        },
    )


def _tabulate_warnings(records: list[Record]) -> str:
    codes = {warning["code"] for record in records for warning in record["warnings"]}
    told = {code: [any(w["code"] == code for w in r["warnings"]) for r in records] for code in codes}
    told["(any warning)"] = [bool(record["warnings"]) for record in records]
    return _count_said("warning", records, told)


def _count_said(name: str, records: list[Record], told: Mapping[str, list[bool]]) -> str:
    """Rows of how often something was said on bad and on good results, the most false alarms first."""
    bad = np.array([bool(reasons(record)) for record in records], dtype=bool)
    found = []
    for what, where in told.items():
        there = np.array(where, dtype=bool)
        on = int((there & bad).sum()), int((there & ~bad).sum())
        found.append((on[1], on[0], what))
    head = [name, f"of {int(bad.sum())} bad", f"of {int((~bad).sum())} good"]
    return lay_out([head, *([what, str(b), str(g)] for g, b, what in sorted(found, reverse=True))])


KEPT = ("group", "case", "points", "grade", "expected", "true", "best_peer", "bad", "checks", "warnings")


def write_csv(path: Path, records: Iterable[Record], *, brief: bool = False) -> None:
    """Write every case as a row: grade, headline, truth, why it is bad and what was said; and, unless the
    table is to be brief, the true errors of every estimate and the raw statistics.
    """
    rows = [_flatten_record(record) for record in records]
    if brief:
        rows = [{name: _round_value(row.get(name)) for name in KEPT} for row in rows]
    names = dict.fromkeys(key for row in rows for key in row)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(names))
        writer.writeheader()
        writer.writerows(rows)


def _round_value(value: object) -> object:
    return round(value, 3) if isinstance(value, float) else value


def _flatten_record(record: Record) -> Record:
    about = {key: record.get(key) for key in ("group", "case", "points", "seconds", "error")}
    if "grade" not in record:
        return about | {"grade": "refused"}
    told = [check for check in record["checks"] if check["grade"] in ("amber", "bad")]
    said = {
        "grade": record["grade"],
        "expected": (record["headline"] or {}).get("all"),
        "true": true_error(record),
        "best_peer": best_peer(record),
        "bad": " ".join(reasons(record)),
        "checks": " ".join(f"{check['name']}={check['grade']}" for check in told),
        "warnings": " ".join(dict.fromkeys(warning["code"] for warning in record["warnings"])),
        "noise_true": record["truth"]["noise"],
    }
    errors = {
        f"true_{name}_{key}": value
        for name, of in record["truth"]["errors"].items()
        for key, value in of.items()
    }
    return about | said | errors | flat_statistics(record)


def flat_statistics(record: Record) -> dict[str, float]:
    """The raw statistics that are numbers."""
    return {key: value for key, value in record.get("stats", {}).items() if isinstance(value, int | float)}


def statistics_of(record: Record) -> dict[str, float]:
    """The numbers of a record that a user's program could know, and ratios of them."""
    found = flat_statistics(record) | {"points": record["points"]}
    if record.get("headline"):
        found |= {f"expected_{k}": v for k, v in record["headline"].items() if v is not None}
    for a, b in RATIOS:
        if found.get(b) and found.get(a) is not None:
            found[f"{a}/{b}"] = found[a] / found[b]
    return {key: float(value) for key, value in found.items()}


def separation(records: list[Record], most: int = 60, least: float = 0.8) -> str:
    """The statistics in the order of their AUC; those that fewer than `least` of the records have are left
    out.
    """
    every = [statistics_of(record) for record in records]
    bad = np.array([bool(reasons(record)) for record in records])
    errors = np.array([true_error(record) for record in records])
    rows = []
    for name in dict.fromkeys(key for one in every for key in one):
        values = np.array([one.get(name, np.nan) for one in every])
        known = np.isfinite(values)
        if known.mean() >= least and np.ptp(values[known]) > 0.0:
            rows.append(_separate_by(name, values[known], bad[known], errors[known]))
    rows.sort(key=lambda row: -row[0])
    head = f"{'statistic':34s} AUC     rank   " + "   ".join(
        f"caught at {x:.0%} (beyond)" for x in FALSE_ALARMS
    )
    return "\n".join([head, *(line for _, line in rows[:most])])


def _separate_by(name: str, values: Array, bad: Array, errors: Array) -> tuple[float, str]:
    found = auc(values[bad == 1], values[bad == 0])
    sign = 1.0 if found >= 0.5 else -1.0
    caught = []
    for share in FALSE_ALARMS:
        limit = float(np.quantile(sign * values[bad == 0], 1.0 - share))
        caught.append(f"{(sign * values[bad == 1] > limit).mean():4.0%} ({sign * limit:.3g})")
    strength = max(found, 1.0 - found)
    rank = rank_correlation(values.tolist(), errors.tolist())
    said = f"{name:34s} {strength:.3f}{'-' if sign < 0 else ' '}  {rank:+.2f}   "
    return strength, said + "         ".join(caught)


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="*", type=Path, help="case folders, or folders of them")
    parser.add_argument("--records", type=Path, help="one JSON line per case; those in it are not run again")
    parser.add_argument("--jobs", type=int, default=1, help="processes side by side")
    parser.add_argument("--folds", type=int, default=0, help="folds of the cross-validation")
    parser.add_argument("--runs", type=Path, help="keep the run folders here")
    parser.add_argument(
        "--peers",
        nargs="*",
        choices=PEERS,
        metavar="NAME",
        help="run these peers, or all, on the cases that have none of them yet",
    )
    parser.add_argument("--table", type=Path, help="print the table of these records")
    parser.add_argument("--csv", type=Path, help="with --table: every case as a row")
    parser.add_argument("--cases", type=Path, help="the same without true errors and statistics")
    parser.add_argument("--again", type=Path, help="grade the run folders kept here anew, into --out")
    parser.add_argument("--separation", type=Path, help="print the separation of these records")
    parser.add_argument("--most", type=int, default=60, help="with --separation: statistics that are shown")
    parser.add_argument("--out", type=Path, help="with --again: where the records go")
    return parser.parse_args()


def _run_cases(arguments: argparse.Namespace) -> None:
    records = read_records(arguments.records)
    listed = find(arguments.folders)
    if arguments.peers is not None:
        names = arguments.peers or list(PEERS)
        graded = [one for one in listed if "grade" in records.get(one.name, {})]
        todo = [one for one in graded if not set(names) & records[one.name].get("peers", {}).keys()]
        work = partial(compared, records={one.name: records[one.name] for one in todo}, names=names)
    else:
        todo = [one for one in listed if one.name not in records]
        work = partial(judged, folds=arguments.folds, keep=arguments.runs)
    with workers(arguments.jobs) as pool:
        _append_records(arguments.records, pool.map(work, todo))


def main() -> None:
    arguments = _parse_arguments()
    if arguments.separation:
        done = [r for r in read_records(arguments.separation).values() if "grade" in r]
        print(separation(done, arguments.most))
        return
    os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    if arguments.again:
        found = (graded_again(r, arguments.again) for r in read_records(arguments.records).values())
        _append_records(arguments.out, found)
    elif not arguments.table:
        _run_cases(arguments)
    shown = arguments.table or arguments.out or arguments.records
    records = list(read_records(shown).values())
    print(table(records))
    if arguments.csv:
        write_csv(arguments.csv, records)
    if arguments.cases:
        write_csv(arguments.cases, records, brief=True)


if __name__ == "__main__":
    main()
