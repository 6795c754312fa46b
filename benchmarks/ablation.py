"""What each rule by which wall is taken away is worth: python -m benchmarks.ablation FOLDER... --records FILE

    python -m benchmarks.cases cross cases/cross --data ../shared/data --only 'cross_*_1_even_*'
    python -m benchmarks.ablation cases/cross --records ablation.jsonl
    python -m benchmarks.ablation cases/unvisited --prior-of template --records lost.jsonl

Every case is fitted once up to the level set, which is then made with all rules, and with each one switched
off. A row of the table: the mean error of both directions (mm) and the share of true vein wall lost with all
rules, and by group how much the rule, when it is off, adds to the error and to the share lost: mean of the
paired differences, their standard error, and how many cases differ.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cases import Listed, find
from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.levelset.result import Result
from o3dls.reconstruction.settings import ReconstructionSettings
from o3dls.stages.level_set import LevelSet
from o3dls.stages.level_set_data import GivenPoints

Record = dict[str, Any]
Change = Callable[[ReconstructionSettings], ReconstructionSettings]
ALL = "all rules"


def _change_surplus(**numbers: float) -> Change:
    return lambda usual: replace(usual, surplus=replace(usual.surplus, **numbers))


RULES: dict[str, Change] = {
    ALL: lambda usual: usual,
    "nothing is taken for want of points": _change_surplus(most=0.0),
    "not where all other wall has points": _change_surplus(even=0.0),
    "not where points close the mouth": _change_surplus(closed=1.1),
    "however little of the mouth is closed": _change_surplus(closed=-1.0),
    "however much all parts are": _change_surplus(most=1.0),
    "no part on a narrow neck": lambda usual: replace(usual, expected=1e9),
    "a patient's part is never given up": lambda usual: replace(
        usual, own_parts=replace(usual.own_parts, evidence=1e9)
    ),
    "a patient's part is given up as lightly": lambda usual: replace(
        usual, own_parts=replace(usual.own_parts, evidence=0.0)
    ),
}


class Altered(LevelSet):
    """The stage with other numbers of the reconstruction."""

    _change: Change = RULES[ALL]

    def _reconstruct_wall(self, case: Case, start: Estimate, given: GivenPoints) -> Result | None:
        from o3dls.adapters.meshing import isosurface
        from o3dls.reconstruction.reconstructed import reconstructed

        settings = self._change(ReconstructionSettings())
        return reconstructed(start.surface, given.believed, case.units, self.spacing, isosurface, settings)


def judged(listed: Listed, prior_of: str | None) -> Iterator[Record]:
    """A record for every rule that is switched off on a case; the fit before the level set is shared."""
    from benchmarks.scores import distance_scores, vein_scores
    from o3dls.pipeline.file import default_pipeline
    from o3dls.pipeline.pipeline import Pipeline

    case = listed.read()
    case = replace(case, **{"prior_of": prior_of}) if prior_of else case
    before = [stage for stage in default_pipeline().allowed_by(case).stages if stage.name != "level_set"]
    estimates = Pipeline(before, folds=0).fit(case)
    start = list(estimates.values())[-1]
    for rule, change in RULES.items():
        stage = Altered()
        stage._change = change
        found = stage(start.corrected(case).visible(stage.fits), start)
        lost = vein_scores(case, found.surface).get("vein_lost")
        error = distance_scores(case, found)["ssd"]
        yield {"group": listed.group, "case": listed.name, "rule": rule, "error": error, "lost": lost}


def table(records: list[Record]) -> str:
    """The table of all groups."""
    lines = []
    for group in dict.fromkeys(record["group"] for record in records):
        own = [record for record in records if record["group"] == group]
        usual = {record["case"]: record for record in own if record["rule"] == ALL}
        mean = np.mean([record["error"] for record in usual.values()])
        lost = [record["lost"] for record in usual.values() if record["lost"] is not None]
        lines.append(
            f"{group} ({len(usual)}): {mean:.3f} mm" + (f", lost {np.mean(lost):.1%}" if lost else "")
        )
        for rule in list(RULES)[1:]:
            rows = [record for record in own if record["rule"] == rule]
            lines.append(f"  {rule:42s} {_compare_with_usual(rows, usual)}")
    return "\n".join(lines)


def _compare_with_usual(rows: list[Record], usual: dict[str, Record]) -> str:
    """What a rule that is off adds, over all cases of a group."""
    more = np.array([row["error"] - usual[row["case"]]["error"] for row in rows])
    lost = [row["lost"] - usual[row["case"]]["lost"] for row in rows if row["lost"] is not None]
    se = more.std(ddof=1) / np.sqrt(len(more)) if len(more) > 1 else float("nan")
    said = f"{more.mean():+.3f} +- {se:.3f} mm, {(np.abs(more) > 1e-6).sum()} differ"
    return said + (f", lost {np.mean(lost):+.1%}" if lost else "")


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="*", type=Path, help="case folders, or folders of them")
    parser.add_argument("--prior-of", choices=("patient", "template"), help="in place of what the cases say")
    parser.add_argument("--records", type=Path, help="one JSON line per case and rule; those in it stay")
    return parser.parse_args()


def main() -> None:
    arguments = _parse_arguments()
    path = arguments.records
    lines = path.read_text().splitlines() if path and path.is_file() else []
    records: list[Record] = [json.loads(line) for line in lines]
    done = {record["case"] for record in records}
    for listed in find(arguments.folders) if arguments.folders else []:
        if listed.name in done:
            continue
        found = list(judged(listed, arguments.prior_of))
        records += found
        print(f"{listed.name} done", file=sys.stderr, flush=True)
        if path:
            with path.open("a") as file:
                file.writelines(json.dumps(record) + "\n" for record in found)
    print(table(records))


if __name__ == "__main__":
    main()
