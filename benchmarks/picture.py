"""Draw the error over the number of points: python -m benchmarks.picture RECORDS... --out PICTURE

RECORDS are what `python -m benchmarks.accuracy ... --records FILE` wrote of crossed atria
(`cross_<points>_<noise>_<even|clustered>...`): a panel for each noise and spread, a line for each method, the
mean over the cases with its standard error. In clustered maps it is the error in seen areas.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from typing import Any

import numpy as np

Record = dict[str, Any]
GROUP = re.compile(r"cross_(\d+)_([\d.]+)_(\S+)$")
SHOWN = {  # method: what it is called, colour
    "icp": ("icp (similarity)", "#9aa0a6"),
    "deform": ("T alone", "#e8a33d"),
    "level_set": ("T and φ", "#1f6fb4"),
    "poisson": ("screened Poisson", "#3c9d5a"),
    "pycpd": ("pycpd", "#a05fb5"),
    "thin-plate": ("thin-plate warp", "#c8523c"),
    "nricp_sumner": ("nricp", "#7d6b5d"),
}


def panels(records: list[Record]) -> dict[tuple[str, str], dict[str, dict[int, list[float]]]]:
    """Errors by panel (noise, spread), method and number of points."""
    found: dict[tuple[str, str], dict[str, dict[int, list[float]]]] = {}
    for record in records:
        group = GROUP.match(record["group"])
        if group and record["method"] in SHOWN:
            lines = found.setdefault((group[2], group[3]), {})
            error = record.get("ssd_seen", record["ssd"])
            lines.setdefault(record["method"], {}).setdefault(int(group[1]), []).append(error)
    return found


def draw(records: list[Record], out: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    every = sorted(panels(records).items())
    figure, axes = plt.subplots(1, len(every), figsize=(5.2 * len(every), 4.4), sharey=True, squeeze=False)
    for axis, ((noise, spread), lines) in zip(axes[0], every, strict=True):
        for method, (name, colour) in SHOWN.items():
            if method in lines:
                _line(axis, lines[method], name, colour, 2.4 if method == "level_set" else 1.2)
        axis.set(xscale="log", yscale="log", xlabel="points", title=_title(noise, spread))
        axis.grid(alpha=0.3, which="both")
    axes[0][0].set_ylabel("mean distance to and from the true wall, mm")
    axes[0][-1].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(out, dpi=110)


def _line(axis: Any, errors: dict[int, list[float]], name: str, colour: str, width: float) -> None:
    points = sorted(errors)
    mean = [np.mean(errors[n]) for n in points]
    deviation = [np.std(errors[n], ddof=1) / np.sqrt(len(errors[n])) for n in points]
    axis.errorbar(points, mean, deviation, label=name, color=colour, lw=width, marker="o", ms=3, capsize=2)


def _title(noise: str, spread: str) -> str:
    words = spread.replace("_outliers", ", 5 % outliers")
    return f"{noise} mm of noise, {words}" + (", seen areas" if "clustered" in spread else "")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("records", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    records = [json.loads(line) for path in arguments.records for line in path.read_text().splitlines()]
    draw(records, arguments.out)


if __name__ == "__main__":
    main()
