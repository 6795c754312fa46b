"""Numbers of how a part of a map is found that is shifted as a whole."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import number


@dataclass(frozen=True)
class MapShiftSettings:
    """These settings say when one part of the map is taken to be shifted against the others, and not the wall
    to have moved.
    """

    offset_sd: float = number(0.4, "rms radii", "prior sd of an offset along each axis: 10 mm for an atrium")
    least_part: float = number(0.1, "1", "smallest share of the points that may be a shifted part in time")
    least_side: float = number(
        0.2, "1", "smallest share of the points on a side of a plane: less is a bump of the wall"
    )
    most_cuts: int = number(
        128, "", "most cuts tried per direction: a few points on the wrong side hide an offset"
    )
    first_evidence: float = number(
        4.0, "nats", "evidence in closed form for one side of a plane to be worth a fit without the offset"
    )
    first_in_order: float = number(
        -2.0,
        "nats",
        "evidence in closed form for a part in time to be worth a fit: most whole maps have less",
    )
    first_offset: float = number(
        0.12, "rms radii", "shortest offset for a part in time to be worth a fit without the offset"
    )
    first_over_motion: float = number(
        1.4,
        "1",
        "shortest offset of a side worth a fit, over the rms motion, which follows it in part",
    )
    rivals: int = number(
        2, "", "planes for which a fit is made: the best in closed form is not always the right one"
    )
    rounds: int = number(5, "", "most rounds of fitting the motion without the offset, then the offset again")
    settled: float = number(0.1, "noise levels", "change of an offset in a round below which it is settled")
    hopeless: float = number(0.5, "1", "share of what an offset needs below which no further round helps it")
    landmark_odds: float = number(
        7.0, "nats", "log odds against landmarks that move along, or against having none that stay"
    )
    evidence: float = number(
        10.0, "nats", "evidence that a shifted part needs: in time, whole maps have 3 at most"
    )
    evidence_per_point: float = number(
        0.04,
        "nats",
        "evidence that a shifted part needs per point of a large map: points share what they show",
    )
    least_points: int = number(
        150, "points", "fewest points that tell one shifted side of a plane from another anatomy"
    )
    least_offset: float = number(
        0.15, "rms radii", "shortest offset of one side of a plane: bends move it by as much"
    )
    over_motion: float = number(
        3.2, "1", "shortest offset of one side of a plane over the rms motion: 2.9 in a map that is whole"
    )
    large_offset: float = number(
        0.25,
        "rms radii",
        "offset above which `over_motion` grows in proportion: a slip leaves the motion as it is",
    )
    place: float = number(
        0.7,
        "rms radii",
        "radius of a ball that holds all mapped points of a vein or an appendage: 18 mm for an atrium",
    )
    shared: float = number(
        0.25,
        "1",
        "share of the evidence left without any one place: 0.34 of shifts, 0.19 of a lacking vein",
    )
