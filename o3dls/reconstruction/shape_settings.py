"""Numbers of which parts and handles a reconstructed wall has."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import number


@dataclass(frozen=True)
class SurplusSettings:
    """These settings say which parts of the moved prior are removed because points show that they are not
    there.
    """

    cell: float = number(0.04, "rms radii", "spacing of the lattice on which surplus parts are cut off: 1 mm")
    reach: float = number(
        1.0,
        "distances between points",
        "distance to the nearest point within which wall counts as having points",
    )
    cosine: float = number(
        0.5, "1", "least cosine between a point's normal and a step that leads through its wall"
    )
    covered: float = number(
        0.05, "1", "cost of new wall with points, over that of new wall, or wall, without"
    )
    support: float = number(10.0, "1", "cost of giving up wall with points")
    expected: float = number(1.0, "points", "points that a part must have room for before it can lack them")
    most: float = number(0.16, "1", "largest share of the wall in all surplus parts: more was not visited")
    supported: float = number(0.1, "1", "share of a part's wall with points, above which the part is there")
    severed: float = number(
        3.0,
        "points",
        "points on wall that hangs on a part, from which the part is there: fewer span no surface",
    )
    closed: float = number(
        0.2, "1", "share of a part's mouth that points must close: a cut in unvisited wall has hardly any"
    )
    elsewhere: float = number(
        0.09,
        "1",
        "share of other wall without points, beyond chance, below which nothing is unmapped",
    )
    fringe: float = number(
        0.8,
        "reaches / rms radius",
        "share of wall without points beside cuts: replaces `elsewhere` where it is less",
    )
    even: float = number(
        1.08, "1", "evenness below which points are evenly spread: 1 at random, 1.2 and more in clusters"
    )


@dataclass(frozen=True)
class OwnPartSettings:
    """These settings say when a part of the patient's own anatomy is given up: never because no catheter was
    there.
    """

    reach: float = number(
        1.0, "clips", "distance from the new wall beyond which the prior's inside is a lost part"
    )
    evidence: float = number(
        15.0,
        "nats",
        "nats by which points must be likelier without a patient's own part: three that lie deep",
    )


@dataclass(frozen=True)
class HandleSettings:
    """These settings say which handles a reconstruction keeps, and how it gets rid of the others."""

    evidence: float = number(
        3.0, "nats", "nats by which points must be likelier with a handle than without it"
    )
    least_cut: float = number(
        0.009,
        "squared rms radii",
        "area of the cut of a handle from which points are asked: 8 mm^2; smaller handles are cut",
    )
    most_handles: int = number(
        6, "", "most handles about which points are asked, those with the largest cuts first"
    )
    most_parts: int = number(8, "", "most parts of a filling that are tested for lying outside the tunnel")
    reach: float = number(4.0, "noises", "distance within which a place of the wall may have caused a point")
    floor: float = number(1e-4, "1 / noise", "density of points that no wall caused")
