"""Numbers of who touches the wall."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import number


@dataclass(frozen=True)
class ContactSettings:
    """These settings say how points that do not touch the wall are expected to lie: mostly inside the
    chamber, and in runs.
    """

    outlier_fraction: float = number(
        0.08, "1", "expected share of outliers, before points are seen: maps have 2 to 20 %"
    )
    inside_fraction: float = number(
        0.9, "1", "expected share of the outliers that lie inside: catheters float in blood"
    )
    inside_points: float = number(
        10.0, "points", "weight of the expected inside fraction against the outliers of the case"
    )
    depth: float = number(0.4, "rms radii", "one over the density of outliers inside, however deep they are")
    scatter: float = number(1.2, "rms radii", "one over the density of the outliers that lie anywhere")
    least_fraction: float = number(
        0.005, "1", "smallest share of outliers: no map is so good that nothing could be one"
    )
    most_fraction: float = number(
        0.5, "1", "largest share of outliers: with more of them than points on the wall, no wall is known"
    )
    most_persistence: float = number(0.9, "1", "largest persistence: a run of outliers must be able to end")
    persistence_pairs: float = number(
        20.0, "pairs", "weight of no persistence against the pairs of consecutive outliers that are seen"
    )
    neighbours: int = number(
        16, "points", "number of others within the median ball: points with fewer in it are isolated"
    )
    least_neighbours: float = number(
        0.3, "points", "number added to the neighbours of a point, so that none counts as this many"
    )
    isolation_small: float = number(
        0.25,
        "rms radii",
        "radius of the neighbours' ball below which isolation counts in full: 1000 points and more",
    )
    isolation_large: float = number(
        0.35, "rms radii", "radius of the neighbours' ball above which isolation shows nothing: 250 points"
    )
    company: int = number(16, "points", "number of nearest points whose contact tells of a point")
    company_usual: float = number(
        2.0, "points", "weight of the usual share of outliers against the neighbours of a point"
    )
    company_floats: float = number(
        0.4,
        "1",
        "share of floating neighbours from which they count: scattered outliers are 2 to 20 % of a map",
    )
    company_most: float = number(0.97, "1", "largest share of outliers that neighbours can tell of")
    crowd: float = number(
        0.37, "rms radii", "distance within which `inside` points bound the same part of the wall"
    )


@dataclass(frozen=True)
class CurvedWallSettings:
    """These settings say how far the curvature of a wall is believed."""

    most_curvature: float = number(
        5.0, "1 / rms radii", "largest curvature of a wall: larger ones are noise of the mesh"
    )
    most_bias: float = number(
        0.6, "1", "noise times curvature above which the bias of a curved wall is not to be trusted"
    )


@dataclass(frozen=True)
class DuplicateSettings:
    """These settings say when points are so close together that they are one place of the catheter, and no
    new evidence.
    """

    distances: tuple[float, ...] = number(
        (0.06, 0.03, 0.015),
        "rms radii",
        "distances within which points may be one place: 1.6 mm and less for an atrium",
    )
    ring: float = number(4.0, "distances", "radius of the ring that shows how many neighbours chance gives")
    growth_pairs: float = number(
        20.0,
        "pairs",
        "weight of pairs growing as over an area against the ring's own growth: lines grow less",
    )
    excess: float = number(
        1.25, "1", "factor on the neighbours by chance: sites of uneven density stay below it"
    )
    excess_sd: float = number(
        4.0, "sd", "standard deviations of the count by chance by which duplicates must exceed it"
    )
    excess_pairs: float = number(
        5.0, "pairs", "pairs beyond chance that duplicates must have: few pairs show nothing"
    )


@dataclass(frozen=True)
class MixtureSettings:
    """These settings govern expectation maximisation over signed distances."""

    iterations: int = number(40, "", "most iterations: the mixture mostly rests after ten")
    tolerance: float = number(1e-4, "1", "relative change of the noise below which the mixture rests")
    least_noise: float = number(4e-6, "rms radii", "smallest noise, for points that lie on the surface")
