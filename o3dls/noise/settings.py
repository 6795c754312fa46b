"""Numbers of who touches the wall."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import number


@dataclass(frozen=True)
class ContactSettings:
    """How points that do not touch the wall are expected to lie: mostly inside the chamber, and in runs."""

    outlier_fraction: float = number(0.08, "1", "of the points, before any is seen: maps have 2 to 20 %")
    inside_fraction: float = number(0.9, "1", "of the outliers, before any is seen: catheters float in blood")
    inside_points: float = number(10.0, "points", "weight of that fraction against the outliers of the case")
    depth: float = number(0.4, "rms radii", "one over the density of outliers inside, however deep they are")
    scatter: float = number(1.2, "rms radii", "one over the density of the outliers that lie anywhere")
    least_fraction: float = number(0.005, "1", "no map is so good that nothing could be an outlier")
    most_fraction: float = number(0.5, "1", "with more outliers than points on the wall, no wall is known")
    most_persistence: float = number(0.9, "1", "a run of outliers must be able to end")
    persistence_pairs: float = number(
        20.0, "pairs", "weight of no persistence against pairs of outliers seen"
    )
    neighbours: int = number(16, "points", "in a ball: points with fewer others around them are isolated,")
    least_neighbours: float = number(0.3, "points", "as which none counts;")
    isolation_small: float = number(0.25, "rms radii", "radius of a ball that tells: 1000 points and more,")
    isolation_large: float = number(0.35, "rms radii", "and of one that tells nothing: 250 points")
    crowd: float = number(0.37, "rms radii", "inside points closer together bound the same part of the wall")


@dataclass(frozen=True)
class DuplicateSettings:
    """When points are so close together that they are one place of the catheter, and no new evidence."""

    distances: tuple[float, ...] = number(
        (0.06, 0.03, 0.015), "rms radii", "what may be one place: 1.6 mm and less for an atrium"
    )
    ring: float = number(4.0, "distances", "radius of the ring that tells how many neighbours chance gives,")
    growth_pairs: float = number(
        20.0, "pairs", "weight of pairs that grow as over an area against the ring's own: lines grow less"
    )
    excess: float = number(1.25, "1", "neighbours over those by chance: sites of uneven density stay below")
    excess_sd: float = number(4.0, "sd", "and so many standard deviations of a count by chance above it,")
    excess_pairs: float = number(5.0, "pairs", "and so many pairs, since few pairs tell nothing")


@dataclass(frozen=True)
class MixtureSettings:
    """Expectation maximisation over signed distances."""

    iterations: int = number(40, "", "most; it mostly rests after ten")
    tolerance: float = number(1e-4, "1", "relative change of the noise at rest")
    least_noise: float = number(1e-9, "rms radii", "points that lie on the surface to the digit")
