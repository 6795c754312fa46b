"""The cases of a benchmark: which there are in a folder, and which group each belongs to."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from o3dls.case import Case
from o3dls.errors import InputError
from o3dls.io.case_reader import read_case

# groups as benchmarks.accuracy names them
SEEDED = re.compile(
    r"(lah|la|(?:jar|star|extra|missing|sparse|beside)_\d+|cross_\d+_\S+|family_[a-z]+_\S+"
    r"|unvisited_[a-z]+_\d+_[a-z]+|badly_segmented_\d+_[a-z]+|altered_[a-z]+_\d+)_(\d+)$"
)
# groups that share one setting of the peers: crossed atria by number of points, families by name and strength
TUNED_TOGETHER = re.compile(r"(cross_\d+|family_[a-z]+_[\d.]+)(?:_|$)")


@dataclass(frozen=True, order=True)
class Listed:
    """A case folder, perhaps with another file of points; `seed` is None where the case came from no
    generator.
    """

    group: str
    name: str
    folder: Path
    points: Path | None = None
    seed: int | None = None

    def read(self) -> Case:
        """The case; where other points are fitted, the ablation points are those of the case itself, for
        scoring.
        """
        case = read_case(self.folder)
        if self.points is None:
            return case
        noisy = read_case(self.folder, points=self.points)
        columns = {
            k: np.concatenate(
                [v[noisy.points.type != "ablation"], case.points.columns[k][case.points.type == "ablation"]]
            )
            for k, v in noisy.points.columns.items()
            if k in case.points.columns
        }
        keep = noisy.points.type != "ablation"
        own = case.points.type == "ablation"
        xyz = np.vstack([noisy.points.xyz[keep], case.points.xyz[own]])
        kind = np.concatenate([noisy.points.type[keep], case.points.type[own]])
        return replace(noisy, points=replace(noisy.points, xyz=xyz, type=kind, columns=columns, order=None))


def tuned_as(group: str) -> str:
    """Name that a group's settings of the peers have."""
    wider = TUNED_TOGETHER.match(group)
    return wider[1] if wider else group


def find(folders: Iterable[Path]) -> list[Listed]:
    """Every case folder among or in the folders given, sorted by group. Raises InputError where there is
    none.
    """
    found = sorted(
        {case for folder in folders for case in _in(Path(folder))},
        key=lambda c: (c.group, c.seed or 0, c.name),
    )
    if not found:
        raise InputError(f"no case folder (with points.csv and prior.*) in {', '.join(map(str, folders))}")
    return found


def _in(folder: Path) -> Iterator[Listed]:
    for path in [folder, *sorted(p for p in folder.rglob("*") if p.is_dir())]:
        if not (path / "points.csv").is_file() or not list(path.glob("prior.*")):
            continue
        seeded = SEEDED.match(path.name)
        if seeded:
            yield Listed(seeded[1], path.name, path, None, int(seeded[2]))
            continue
        yield Listed(path.name, path.name, path)
        # the same case with other points, such as noisier ones
        for other in sorted(path.glob("points_*.csv")):
            name = f"{path.name}+{other.stem.removeprefix('points_')}"
            yield Listed(name, name, path, other)
