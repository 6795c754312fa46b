"""Numbers of changes of topology, in radii of the body: d * volume / area, 16 mm for an atrium."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..noise.settings import ContactSettings, CurvedWallSettings
from ..settings import number


@dataclass(frozen=True)
class ObservationSettings:
    """These settings say how points are seen from a wall."""

    least_outliers: float = number(
        0.02, "1", "smallest outlier fraction that is believed, except for 0, where all points touch"
    )
    most_outliers: float = number(
        0.3, "1", "largest outlier fraction that is believed: with more, too few points would count"
    )
    curved: CurvedWallSettings = field(default_factory=CurvedWallSettings)
    contact: ContactSettings = field(default_factory=ContactSettings)


@dataclass(frozen=True)
class CutSettings:
    """These settings say which thin parts of the prior may be cut off."""

    lattice: float = number(
        6.0, "nodes / radius", "nodes per radius of the lattice on which thin parts are looked for"
    )
    balls: tuple[float, ...] = number(
        (0.35, 0.5, 0.65), "radii", "radii of the balls that thin parts do not admit"
    )
    sticks_out: float = number(0.3, "radii", "height over the opened body that a thin part must reach")
    deep: float = number(
        2.0, "noise levels", "depth inside the wall from which a point may tell against a part"
    )
    witnesses: int = number(3, "points", "points that must support a cut")
    telling: float = number(
        0.5, "nats", "gain from which a point supports a cut: the new wall explains it so much better"
    )
    trial_step: float = number(0.5, "noise levels", "step between the heights at which a cut is tried")


@dataclass(frozen=True)
class TubeSettings:
    """These settings say which tubes may be grown: veins and handles that the prior lacks."""

    far: float = number(
        2.0, "noise levels", "distance outside the surface from which a point asks for a tube"
    )
    link: float = number(0.6, "radii", "distance within which points may trace one tube")
    seeds: int = number(3, "points", "far points that start a tube: nearer ones join in")
    witnesses: int = number(5, "points", "points that must support a tube: it has eight numbers to be fitted")
    telling: float = number(
        0.5, "nats", "gain from which a point supports a tube: the new wall explains it so much better"
    )
    nearby: float = number(
        2.0, "radii", "distance from a cluster within which points are asked about its tube"
    )
    radius: float = number(0.35, "radii", "expected radius of a tube: a vein of 5.5 mm on a body of 16 mm")
    radius_log_sd: float = number(
        0.35, "1", "log_sd of a tube's radius: veins and appendages differ by so much"
    )
    taper_log_sd: float = number(0.15, "1", "log_sd of the ratio of a tube's radii at its ends")
    rooted: float = number(0.5, "tube radii", "depth of a tube's foot in the body: less costs nats")
    sticks_out: float = number(
        0.5, "radii", "height that a tube must reach, and its distance from thin parts of the prior"
    )
    ball: float = number(
        0.5, "radii", "radius of the ball that finds thin parts of the prior, from which tubes stay away"
    )
    large: float = number(4.4, "squared radii", "area of new wall that few veins add: a third of a ball")
    widest: float = number(0.6, "radii", "radius that no vein or appendage has: those added had up to 0.38")
    others: float = number(
        0.2, "1", "far points around a large tube over those on it, above which the tube is a chamber"
    )
    expected_points: float = number(
        0.5, "1", "points that new wall gathers over evenly spread ones: some walls are never touched"
    )
    another: float = number(
        0.5, "nats", "nats by which a later search must end lower to have found another tube"
    )
    steps: tuple[float, ...] = number(
        (0.05, 0.2, -0.2),
        "radii, or logarithms",
        "first steps of the first search for a tube and of those after it",
    )
    search_iterations: int = number(600, "", "most iterations of one search for a tube")
    search_tolerance: float = number(
        0.02, "nats, or coordinates", "change below which a search for a tube comes to rest"
    )
    lattice: float = number(
        6.0, "nodes / tube radius", "nodes per tube radius of the lattice on which a tube is meshed"
    )


@dataclass(frozen=True)
class TopologySettings:
    """These are all numbers of changes of topology."""

    evidence: float = number(
        5.0, "nats", "evidence that a change of topology must have: a rare thing needs good reasons"
    )
    most_changes: int = number(4, "", "most changes of one prior: more would make it another one")
    proposing_points: int = number(
        1000, "points", "most points of a kind that propose changes: topology is no detail"
    )
    trial_points: int = number(
        500, "points", "most points of a kind that judge a change: four times as fast as all that propose"
    )
    trial_rows: int = number(
        300, "rows", "rows of a trial's linear system: more points share rows by patches of the surface"
    )
    trial_lead: float = number(
        8.0, "nats", "nats that a trial may lack in a round and still go on: no more is made up for later"
    )
    early_rounds: tuple[int, ...] = number(
        (2, 3),
        "",
        "rounds before tuning at which a trial may end: noise counts 1.5 and 1.2 times",
    )
    trial_spacings: tuple[float, ...] = number(
        (2.0, 1.5, 1.0),
        "spacings",
        "lattice spacings for trials: the first that keeps the prior whole is used",
    )
    least_area: float = number(
        0.8, "areas", "share of the prior's area that must be left for the prior to be whole"
    )
    judged: int = number(3, "", "most tubes, and most cuts, that are judged: the likeliest")
    cuts: CutSettings = field(default_factory=CutSettings)
    tubes: TubeSettings = field(default_factory=TubeSettings)
    observation: ObservationSettings = field(default_factory=ObservationSettings)
