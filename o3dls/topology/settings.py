"""Numbers of changes of topology, in radii of the body: d * volume / area, 16 mm for an atrium."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..noise.settings import ContactSettings
from ..settings import number


@dataclass(frozen=True)
class ObservationSettings:
    """How points are seen from a wall."""

    least_outliers: float = number(
        0.02, "1", "a smaller fraction is not believed, but for 0: then all touch,"
    )
    most_outliers: float = number(0.3, "1", "nor a larger one: corrections would hear too few")
    exact_noise: float = number(4e-6, "rms radii", "noise of points that lie on the surface as it is")
    most_curvature: float = number(5.0, "1 / rms radii", "larger curvatures are noise of the mesh")
    most_bias: float = number(0.6, "1", "noise times curvature beyond which the bias is not to be trusted")
    contact: ContactSettings = field(default_factory=ContactSettings)


@dataclass(frozen=True)
class CutSettings:
    """Which thin parts of the prior may be cut off."""

    lattice: float = number(6.0, "nodes / radius", "on which parts are looked for")
    balls: tuple[float, ...] = number((0.35, 0.5, 0.65), "radii", "of balls that thin parts do not admit")
    sticks_out: float = number(0.3, "radii", "a part reaches at least so far off the opened body")
    deep: float = number(2.0, "noise levels", "inside, from which a point may tell against a part")
    witnesses: int = number(3, "points", "that must tell for a cut")
    telling: float = number(0.5, "nats", "by which the new wall explains such a point better")
    trial_step: float = number(0.5, "noise levels", "between heights at which a part may be cut")
    untouched: float = number(
        1.5, "nats", "that a part without a single point is worth: one wall in five is never touched anyway"
    )


@dataclass(frozen=True)
class TubeSettings:
    """Which tubes may be grown: veins and handles that the prior lacks."""

    far: float = number(2.0, "noise levels", "off the surface, from which a point asks for a tube")
    link: float = number(0.6, "radii", "points closer than this may trace one tube")
    seeds: int = number(3, "points", "far off, that start a tube; nearer ones join in")
    witnesses: int = number(5, "points", "that must trace a tube: it has eight numbers to be fitted")
    telling: float = number(0.5, "nats", "by which the new wall explains such a point better")
    nearby: float = number(2.0, "radii", "points so near to a cluster are asked about its tube")
    radius: float = number(0.35, "radii", "of a usual tube: a vein of 5.5 mm on a body of 16 mm,")
    radius_log_sd: float = number(0.35, "1", "and of its logarithm: veins and appendages differ by so much")
    taper_log_sd: float = number(0.15, "1", "of one end's radius over the other's")
    rooted: float = number(0.5, "tube radii", "its foot lies so deep in the body, or it costs")
    sticks_out: float = number(
        0.5, "radii", "and stays away from thin parts that are there: else it is no tube"
    )
    ball: float = number(0.5, "radii", "of the ball that finds those parts")
    large: float = number(4.4, "squared radii", "of new wall that few veins add: a third of a ball")
    largest: float = number(9.0, "squared radii", "that no vein adds: two thirds of a ball")
    others: float = number(0.2, "1", "far points around a large tube over those on it: then it is a chamber")
    expected_points: float = number(
        0.5, "1", "that a new wall gathers, over evenly spread ones: some walls are never touched"
    )
    another: float = number(
        0.5, "nats", "by which a search must come to rest lower, to have found another tube"
    )
    steps: tuple[float, ...] = number(
        (0.05, 0.2, -0.2), "radii, or logarithms", "first steps of a search and of those after it"
    )
    search_iterations: int = number(600, "", "most of one search")
    search_tolerance: float = number(0.02, "nats, or coordinates", "at which a search comes to rest")
    lattice: float = number(6.0, "nodes / tube radius", "on which a tube is meshed")


@dataclass(frozen=True)
class TopologySettings:
    """All numbers of changes of topology."""

    evidence: float = number(5.0, "nats", "that a change must earn: a rare thing needs good reasons")
    most_changes: int = number(4, "", "of one prior: more would be another one")
    most_points: int = number(1000, "points", "of a kind that propose: topology is no detail,")
    trial_points: int = number(500, "points", "of a kind that judge: four times as fast as all that propose")
    trial_rows: int = number(300, "rows", "more points of a trial share rows by patches of the surface")
    trial_lead: float = number(
        8.0, "nats", "that a trial may lack in a round and go on: no more is made up for later"
    )
    early_rounds: tuple[int, ...] = number(
        (2, 3),
        "",
        "in which a trial may end too, before tuning: noise counts 1.5 and 1.2 times",
    )
    trial_spacings: tuple[float, ...] = number(
        (2.0, 1.5, 1.0),
        "spacings",
        "of lattices for trials: the first that keeps the prior whole",
    )
    least_area: float = number(0.8, "areas", "of the prior that must be left for it to be whole")
    judged: int = number(3, "", "tubes, and cuts, that are judged: those that the likelihood prefers")
    half_band: float = number(3.0, "spacings", "half width of the band on which the prior is changed")
    cuts: CutSettings = field(default_factory=CutSettings)
    tubes: TubeSettings = field(default_factory=TubeSettings)
    observation: ObservationSettings = field(default_factory=ObservationSettings)
