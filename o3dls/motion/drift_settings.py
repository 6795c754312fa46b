"""Numbers of errors that go together along the order of the points."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import number


@dataclass(frozen=True)
class DriftSettings:
    """These settings say how errors of points that are taken one after the other go together."""

    shifts: tuple[float, ...] = number(
        (12.0, 60.0),
        "points",
        "lengths of shifts that go together: a group of electrodes, and breathing or a slip",
    )
    pressures: tuple[float, ...] = number(
        (12.0,), "points", "lengths of a tip's pressure, which moves the wall along its normal"
    )
    usual: float = number(
        0.02, "rms radii", "usual deviation of each length, 0.5 mm per axis, before points are seen"
    )
    log_sd: float = number(1.0, "1", "log_sd of the deviations: a factor of e either way")
    least_pull: float = number(
        1.5, "sd", "score of drift to be worth a look: independent errors reach it on 1 of 15 maps"
    )
    evidence: float = number(
        5.0, "nats", "evidence that errors go together: independent ones gain up to 1, paths 5 to 160"
    )
    least_points: int = number(60, "points", "fewest points whose errors are asked")
    block: float = number(6.0, "points", "part of the order of which points of one patch share a row")
    most_rows: int = number(
        700, "rows", "rows above which the parts and the patches are made larger: more rows change little"
    )
    longer: float = number(1.4, "1", "factor on the parts of the order where there are too many rows")
    wider: float = number(1.2, "1", "factor on the patches where there are too many rows")
    widest: float = number(
        4.0, "1", "largest factor on the patches: maps that need larger ones visit all places all the time"
    )
    at_once: int = number(4000, "points", "points whose covariances with all rows are in memory together")
    scattered: float = number(
        0.5, "1", "median step between points over that of any two, above which no path is in their order"
    )
    detail: float = number(
        0.085, "shortest lengths", "deviation of the shortest fields above which errors may be in the wall"
    )
    doubted: float = number(
        0.1, "1", "share of the variance of that detail that may be errors where the order is lost"
    )

    @property
    def kinds(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Lengths of shifts and of pressure."""
        return self.shifts, self.pressures

    @property
    def names(self) -> list[str]:
        """Names of the deviations, in their order."""
        named = zip(("drift", "pressure"), self.kinds, strict=True)
        return [f"{kind}_{length:g}" for kind, lengths in named for length in lengths]
