"""Whether a change of the program leaves results as they are: python tools/golden.py FOLDER... --out OUT

    python tools/golden.py ../shared/data/phantom ../shared/data/real cases/cross --out before
    python tools/golden.py ../shared/data/phantom ../shared/data/real cases/cross --out after
    python tools/golden.py --compare before after --within 1e-9

Every case is run as `o3dls run` runs it, without folds. Of each estimate its surface is kept, and in words
what was decided: status, warnings, validity. The comparison prints, by case, the largest distance between
vertices of the same number (mm, over all estimates), decisions that differ, and the seconds of both; it ends
with 1 where a case differs.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from benchmarks.cases import Listed, find

Record = dict[str, Any]


def kept(listed: Listed, out: Path) -> None:
    """Run a case, and keep surfaces, fields and decisions of its estimates in `out`/case.npz."""
    from o3dls.pipeline.file import default_pipeline

    case = listed.read()
    begin = perf_counter()
    run = default_pipeline().allowed_by(case)
    estimates = type(run)(run.stages, folds=0).run(case).estimates
    decisions: Record = {"seconds": perf_counter() - begin, "estimates": {}}
    arrays = {}
    for name, one in estimates.items():
        arrays[f"{name}/vertices"], arrays[f"{name}/faces"] = one.surface.vertices, one.surface.faces
        arrays |= {f"{name}/field {field}": values for field, values in one.surface.fields.items()}
        warnings = [[warning.code, warning.sentence] for warning in one.warnings]
        decisions["estimates"][name] = {
            "status": one.status,
            "converged": one.converged,
            "sigma": one.sigma,
            "warnings": warnings,
        }
    np.savez(out / f"{listed.name}.npz", decisions=np.array(json.dumps(decisions)), **arrays)


def compared(before: Path, after: Path, within: float) -> tuple[str, bool]:
    """A line on one case before and after, and whether both are the same within a distance (mm)."""
    old, new = np.load(before), np.load(after)
    said = [json.loads(str(one["decisions"])) for one in (old, new)]
    apart = 0.0
    different = sorted({*old.files} ^ {*new.files})
    for name in sorted({*old.files} & {*new.files} - {"decisions"}):
        if old[name].shape != new[name].shape:
            different.append(name)
        elif name.endswith("/faces"):
            different += [name] if (old[name] != new[name]).any() else []
        else:
            difference = np.abs(np.nan_to_num(old[name]) - np.nan_to_num(new[name])).max(initial=0.0)
            apart = max(apart, float(difference))
    for name in said[0]["estimates"].keys() & said[1]["estimates"].keys():
        one, other = (side["estimates"][name] for side in said)
        different += [f"{name}/{key}" for key in one if key != "sigma" and one[key] != other[key]]
    seconds = " -> ".join(f"{side['seconds']:.1f}" for side in said)
    same = apart <= within and not different
    line = f"{before.stem:44s} {apart:9.2e}  {seconds:>16s} s  {'same' if same else ', '.join(different)}"
    return line, same


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="*", type=Path, help="case folders, or folders of them")
    parser.add_argument("--out", type=Path, help="where the runs go; those that are there are not made again")
    parser.add_argument("--compare", nargs=2, type=Path, metavar=("BEFORE", "AFTER"), help="two such folders")
    parser.add_argument("--within", type=float, default=1e-9, help="mm, between vertices and in fields")
    return parser.parse_args()


def main() -> int:
    arguments = _parse_arguments()
    if arguments.compare:
        before, after = arguments.compare
        paths = sorted(path for path in before.glob("*.npz") if (after / path.name).is_file())
        found = [compared(path, after / path.name, arguments.within) for path in paths]
        print("\n".join(line for line, _ in found))
        print(f"{sum(same for _, same in found)} of {len(found)} cases are the same")
        return 0 if found and all(same for _, same in found) else 1
    arguments.out.mkdir(parents=True, exist_ok=True)
    for listed in find(arguments.folders):
        if not (arguments.out / f"{listed.name}.npz").is_file():
            kept(listed, arguments.out)
            print(listed.name, file=sys.stderr, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
