"""What the page must show, judged from the rows: each claim with its number, its bound, and whether it
holds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from .blocks import Block, Heading, Table, Text
from .drawing import NAMES
from .experiment import Row
from .results import Results, column
from .temporal import gain

LEAST_FIT = 0.7  # share of the noise per axis: a method whose fitted mean is lower fits the noise
WRONG = "Poses that a registration got wrong"
BASELINE = 0.5  # mm: how near the baseline must be to the paper's


@dataclass(frozen=True)
class Claim:
    words: str
    found: str
    bound: str
    holds: bool

    @property
    def line(self) -> list[str]:
        return [self.words, self.found, self.bound, "yes" if self.holds else "NO"]


def claims(results: Results) -> list[Block]:
    """Tabulate the claims; those whose experiment was not run are left out."""
    found = [*_judge_noise(results), *_judge_atrium(results), *_judge_temporal(results)]
    rows = [claim.line for claim in found]
    return [
        Heading("What must hold"),
        Text(
            "A fitted mean is compared with the noise per axis, of which the true surface itself scores "
            "at most 0.80, less about its "
            "corners; in brackets, with what it does score on the same points."
        ),
        Table(
            "Claims, each with its number from the tables below", ["claim", "found", "bound", "holds"], rows
        ),
    ]


def _judge_noise(results: Results) -> list[Claim]:
    found = []
    for shape in ("star", "jar"):
        for level in sorted({row["percent"] for row in results.of(shape)}):
            rows = results.of(shape, percent=level)
            name = f"{shape}, {level:g} %: level set against rigid ICP"
            fitted, held = (_seed_ratios(rows, key) for key in ("fitted", "held_out"))
            found += [
                Claim(f"{name}, fitted, worst seed", f"{fitted.max():.2f}", "< 1", bool(fitted.max() < 1.0)),
                Claim(
                    f"{name}, held out, mean",
                    f"{_mean_ratio(rows, 'held_out'):.2f}",
                    "< 1",
                    _mean_ratio(rows, "held_out") < 1.0,
                ),
                Claim(
                    f"{name}, held out, worst seed", f"{held.max():.2f}", "<= 1.02", bool(held.max() <= 1.02)
                ),
                _judge_fit(f"{shape}, {level:g} %: mean fitted over noise (over truth's own)", rows),
            ]
    return found


def wrong_poses(results: Results) -> list[Block]:
    """Name every pose that a registration got wrong: a mean over seeds hides it."""
    found = [row for row in results.rows if "best_pose" in row]
    if not found:
        return [Heading(WRONG), Text("None on this page.")]
    lines = [
        [
            _name_case(row),
            NAMES[row["method"]],
            f"{row['wrong_pose_mean']:.2f}",
            f"{row['best_pose_mean']:.2f} ({NAMES.get(row['best_pose'], row['best_pose'])})",
            f"{row['wrong_pose_apart']:.1f}",
        ]
        for row in found
    ]
    head = ["case", "wrong pose of", "points from it", "from the best pose", "between the poses, rms"]
    return [
        Heading(WRONG),
        Text(
            "Each is far from the best pose that was found for the same case, and clearly farther from the "
            "points. It counts in the means below."
        ),
        Table("Wrong poses: mean distances, mm (star: px)", head, lines),
    ]


def _name_case(row: Row) -> str:
    parts = (f"{row['percent']:g} %" if "percent" in row else "", row.get("case", ""))
    seed = f"seed {row['seed']}" if "seed" in row else ""
    return ", ".join(str(part) for part in (row["experiment"], *parts, seed) if part)


def _judge_atrium(results: Results) -> list[Claim]:
    rows = results.of("atrium")
    icp = [row for row in rows if row["method"] == "icp"]
    found = []
    for key, words, wanted in (("fitted", "EAM points", 4.5), ("ablation", "ablation points", 3.2)):
        found.append(
            _judge_baseline(f"atrium: the baseline's {words}, mm (seeds within)", column(icp, key), wanted)
        )
    for key, words, least in (
        ("assd", "true-surface error", 0.46),
        ("ablation", "ablation points, not fitted,", 0.35),
    ):
        fall, against = (1.0 - _mean_ratio(rows, key, base) for base in ("icp", "similarity"))
        words = f"atrium: {words} falls (against the best similarity ICP)"
        found.append(
            Claim(
                words, f"{100 * fall:.0f} % ({100 * against:.0f} %)", f">= {100 * least:.0f} %", fall >= least
            )
        )
    return [*found, _judge_fit("atrium: mean fitted over noise (over truth's own)", rows)]


def _judge_baseline(words: str, values: Array, wanted: float) -> Claim:
    """Judge whether the mean and the standard deviation over seeds stay within half a millimetre of the
    paper's figure.
    """
    mean = values.mean()
    sd = values.std()
    within = np.count_nonzero(np.abs(values - wanted) <= BASELINE)
    found = f"{mean:.2f} ± {sd:.2f} ({within} of {len(values)})"
    return Claim(words, found, f"{wanted:g} ± {BASELINE:g}", bool(abs(mean - wanted) + sd <= BASELINE))


def _judge_temporal(results: Results) -> list[Claim]:
    kinds = sorted({row["map"] for row in results.of("temporal")})
    falls = {kind: gain(results.of("temporal", map=kind)) for kind in kinds}
    words = "temporal template: held-out error on left-out phases falls"
    return [
        Claim(f"{words}, {kind} maps", f"{100 * fall:.0f} %", ">= 30 %", fall >= 0.30)
        for kind, fall in falls.items()
    ]


def _judge_fit(words: str, rows: list[Row]) -> Claim:
    own = [row for row in rows if row["method"] == "level_set"]
    fitted = column(own, "fitted").mean()
    of_truth, of_noise = (float(fitted / column(own, key).mean()) for key in ("floor", "noise"))
    return Claim(words, f"{of_noise:.2f} ({of_truth:.2f})", f">= {LEAST_FIT}", of_noise >= LEAST_FIT)


def _seed_ratios(rows: list[Row], key: str, base: str = "icp") -> Array:
    """Divide the level set's value by the baseline's, seed by seed."""
    ours, theirs = (
        column([row for row in rows if row["method"] == method], key) for method in ("level_set", base)
    )
    return np.asarray(ours / theirs)


def _mean_ratio(rows: list[Row], key: str, base: str = "icp") -> float:
    ours, theirs = (
        column([row for row in rows if row["method"] == method], key).mean() for method in ("level_set", base)
    )
    return float(ours / theirs)
