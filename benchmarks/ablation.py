"""What each rule of the method is worth: python -m benchmarks.ablation FOLDER... --records FILE

    python -m benchmarks.cases paths cases/dev --data ../shared/data
    python -m benchmarks.ablation cases/dev --records rules.jsonl
    python -m benchmarks.ablation cases/dev --records some.jsonl --rules 'parts*' 'steps are mixed'
    python -m benchmarks.ablation cases/dev --records none.jsonl --rules 'parts*' --together
    python -m benchmarks.ablation --records rules.jsonl --by-group
    python -m benchmarks.ablation cases/unvisited --prior-of template --records lost.jsonl

Every case is run as the packaged pipeline has it, once with all rules and once with each one switched off
(benchmarks.rules), from the first stage that the rule concerns; with `--together`, once with all of them
off. A row of the table has the paired differences that a rule makes when it is off: on how many cases the
result differs at all, how much is added to the mean error of both directions (mm: mean, standard error, the
worst case for the rule's lack, the worst case for its presence), to the share of the wall in 95 % bands, to
the share of true vein wall lost (both in points), and to the time. `warnings`: cases whose warnings differ.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from fnmatch import fnmatch
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.cases import Listed, find
from benchmarks.rules import ALL, RULES, Numbers, package_of, switched
from benchmarks.scores import calibration, distance_scores, lay_out, vein_scores
from o3dls.case import Case
from o3dls.estimate import Estimate

Record = dict[str, Any]
STAGES = {"deform": 2, "topology": 3, "level_set": 4}  # their places in the packaged pipeline
# the first stage that the numbers of a package concern; else the first of these
FIRST = {"topology": "topology", "reconstruction": "level_set"}
OF_ONE_STAGE = {"motion", "topology"}  # packages whose numbers no later stage has
DIFFERS = 1e-6  # mm


def judged(listed: Listed, rules: Mapping[str, Numbers], prior_of: str | None = None) -> Iterator[Record]:
    """A record for every rule that is switched off on a case; what is before its first stage is shared."""
    from o3dls.pipeline.file import default_pipeline
    from o3dls.pipeline.pipeline import Pipeline

    case = listed.read()
    case = replace(case, **{"prior_of": prior_of}) if prior_of else case
    stages = default_pipeline().allowed_by(case).stages
    pipeline = Pipeline(stages, folds=0)
    estimates = pipeline.fit(case)
    usual = [estimates.get(name) for name in pipeline.names]  # the start first: each stage's own start
    for rule, numbers in {ALL: {}, **rules}.items():
        packages = {package_of(name) for name in numbers}
        first: int | None = min(
            (STAGES[FIRST.get(one, "deform")] for one in packages), default=STAGES["deform"]
        )
        begin = min(k for k, stage in enumerate(stages) if STAGES.get(stage.name, 1) >= (first or 0))
        alone = bool(packages) and packages <= OF_ONE_STAGE
        with switched(numbers):
            at, found = perf_counter(), usual[begin]
            for k, stage in enumerate(stages[begin:], begin):
                found = stage(found.corrected(case).visible(stage.fits), found)
                if alone and _are_same(found, usual[k + 1]):
                    found, first = usual[-1], None  # no more time would tell anything
                    break
        scores = _score(case, found) | {"seconds": perf_counter() - at, "begin": first}
        yield {"group": listed.group, "case": listed.name, "rule": rule, **scores}


def _are_same(one: Estimate, other: Estimate) -> bool:
    """Whether two estimates have the same surface and fields, to the last digit."""
    fields, usual = one.surface.fields, other.surface.fields
    return (
        np.array_equal(one.surface.vertices, other.surface.vertices)
        and fields.keys() == usual.keys()
        and all(np.array_equal(fields[name], usual[name], equal_nan=True) for name in fields)
        and one.warnings == other.warnings
    )


def _score(case: Case, found: Estimate) -> Record:
    """Error, bands, lost veins and warnings of a result."""
    return {
        "error": distance_scores(case, found)["ssd"],
        "bands": calibration(case, found).get("cover95"),
        "lost": vein_scores(case, found.surface).get("vein_lost"),
        "warnings": sorted(warning.code for warning in found.warnings),
    }


def table(records: list[Record], by_group: bool = False) -> str:
    """The table of all rules over all cases, or of every group."""
    groups = list(dict.fromkeys(record["group"] for record in records)) if by_group else [None]
    return "\n\n".join(_lay_out(records, group) for group in groups)


def _lay_out(records: list[Record], group: str | None) -> str:
    own = [record for record in records if group in (None, record["group"])]
    usual = {record["case"]: record for record in own if record["rule"] == ALL}
    rules = [rule for rule in dict.fromkeys(record["rule"] for record in own) if rule != ALL]
    head = ["differ", "error", "se", "worst", "best", "bands", "lost", "seconds", "warnings"]
    rows = [_compare(rule, [record for record in own if record["rule"] == rule], usual) for rule in rules]
    mean = np.mean([record["error"] for record in usual.values()])
    return f"{len(usual)} cases, {mean:.3f} mm\n" + lay_out([[group or "without", *head], *rows])


def _compare(rule: str, rows: list[Record], usual: Mapping[str, Record]) -> list[str]:
    """A row of the table: what is added where a rule is off."""
    pairs = [(row, usual[row["case"]]) for row in rows]
    more = np.array([row["error"] - other["error"] for row, other in pairs])
    se = more.std(ddof=1) / np.sqrt(len(more)) if len(more) > 1 else float("nan")
    cells = [f"{(np.abs(more) > DIFFERS).sum()}/{len(more)}", f"{more.mean():+.4f}", f"{se:.4f}"]
    cells += [f"{more.max():+.3f}", f"{more.min():+.3f}"]
    for key in ("bands", "lost"):
        both = [(row[key], other[key]) for row, other in pairs if None not in (row[key], other[key])]
        cells.append(f"{100.0 * np.mean([a - b for a, b in both]):+.2f}" if both else "")
    return [rule, *cells, _compare_seconds(pairs), str(sum(a["warnings"] != b["warnings"] for a, b in pairs))]


def _compare_seconds(pairs: list[tuple[Record, Record]]) -> str:
    """Seconds that are added, where both were run from the same stage on."""
    same = [row["seconds"] - other["seconds"] for row, other in pairs if row["begin"] == other["begin"]]
    return f"{np.mean(same):+.2f}" if same else ""


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="*", type=Path, help="case folders, or folders of them")
    parser.add_argument("--prior-of", choices=("patient", "template"), help="in place of what the cases say")
    parser.add_argument("--records", type=Path, required=True, help="JSON lines; cases in it stay")
    parser.add_argument("--rules", nargs="+", default=["*"], metavar="PATTERN", help="only these rules")
    parser.add_argument("--together", action="store_true", help="these rules off at once")
    parser.add_argument("--by-group", action="store_true", help="a table for each group")
    return parser.parse_args()


def main() -> None:
    arguments = _parse_arguments()
    path = arguments.records
    lines = path.read_text().splitlines() if path.is_file() else []
    records: list[Record] = [json.loads(line) for line in lines]
    done = {record["case"] for record in records}
    rules = {name: off for name, off in RULES.items() if any(fnmatch(name, one) for one in arguments.rules)}
    if arguments.together:
        rules = {"all of them": {name: value for off in rules.values() for name, value in off.items()}}
    for listed in find(arguments.folders) if arguments.folders else []:
        if listed.name in done:
            continue
        found = list(judged(listed, rules, arguments.prior_of))
        records += found
        print(f"{listed.name} done", file=sys.stderr, flush=True)
        with path.open("a") as file:
            file.writelines(json.dumps(record) + "\n" for record in found)
    print(table(records, arguments.by_group))


if __name__ == "__main__":
    main()
