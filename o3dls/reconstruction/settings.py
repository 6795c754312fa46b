"""Numbers of the reconstruction."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ..noise.settings import CurvedWallSettings
from ..settings import number
from .shape_settings import HandleSettings, OwnPartSettings, SurplusSettings


@dataclass(frozen=True)
class SplineSettings:
    """These settings describe the field that is added to the moved prior's signed distance: B-splines on
    lattices, each half as wide as the one before.
    """

    coarsest: float = number(
        0.3, "rms radii", "lattice width of the longest splines: 10 mm, about the width of a branch"
    )
    finest_between: float = number(
        0.7,
        "distances between points",
        "smallest lattice width, by the distance between points: finer splines would follow noise",
    )
    finest_noise: float = number(
        1.5, "noise levels", "smallest lattice width, by the noise: finer splines would follow it"
    )
    finest_spacing: float = number(
        1.5, "spacings", "smallest lattice width, by the spacing of phi: finer splines would be lost"
    )
    wall_finest_between: float = number(
        0.3,
        "distances between points",
        "smallest lattice width of the final wall: points with normals show such detail",
    )
    clip: float = number(
        0.15, "rms radii", "distance at which the prior's signed distance is truncated: 5 mm"
    )
    normal_sd: float = number(0.4, "1", "sd of a normal that is found from the points around: 23 degrees")
    offsets: tuple[float, ...] = number(
        (0.09, 0.18),
        "rms radii",
        "distances off the wall at which points off the moved prior show a sign too: 3 and 6 mm",
    )
    offset_noise: float = number(2.0, "noise levels", "distance above which a point lies off the moved prior")
    offset_cosine: float = number(
        0.5, "1", "cosine to the prior's normal below which a point shows another wall"
    )
    offset_neighbours: int = number(
        5, "points", "nearest points of which most must lie off the moved prior too"
    )
    covered: float = number(
        1.0,
        "distances between points",
        "distance to a point on the wall in front below which a point inside floats",
    )
    offset_sd: float = number(0.35, "offsets", "uncertainty of the distance at an offset place")
    offset_clear: float = number(
        0.7, "offsets", "distance that an offset place must have from the nearest point"
    )
    tolerance: float = number(1e-3, "1", "relative residual at which conjugate gradients end: 0.01 mm")
    iterations: int = number(300, "", "most iterations of conjugate gradients")


@dataclass(frozen=True)
class NormalSettings:
    """These settings say how normals of points are found: planes through their neighbours, sides by the
    winding number.
    """

    radius: float = number(
        0.15, "rms radii", "radius of the neighbourhood that gives a normal: 5 mm, about a vein's radius"
    )
    radius_noise: float = number(
        4.0,
        "noise levels",
        "smallest radius of the neighbourhood that gives a normal: planes must not follow noise",
    )
    thinning: float = number(
        0.33, "radii", "width of the cells of which a neighbourhood takes one point each"
    )
    least: int = number(12, "points", "fewest points in a neighbourhood, however far they are")
    most: int = number(64, "points", "most points in a neighbourhood")
    flat: float = number(
        0.45,
        "1",
        "smallest over middle variance of neighbours below which their normal can show another wall",
    )
    most_tilt: float = number(1.5, "rad", "largest deviation of a normal: such a one says nothing")
    tree_neighbours: int = number(
        12, "points", "nearest points with whose normals a point's own may be made to agree"
    )
    rounds: int = number(10, "", "most rounds of turning normals: it ends when none turns any more")
    rounds_again: int = number(
        2, "", "most rounds of turning normals that were turned before, with other contact probabilities"
    )
    largest_area: float = number(
        4.0, "medians", "largest area of wall that a point stands for: wall beyond it is unmapped"
    )
    cell: float = number(0.06, "rms radii", "width of the cells whose points share a dipole: 2 mm")
    far_cell: float = number(0.2, "rms radii", "width of the cells whose dipoles are one, seen from afar")
    far: float = number(
        0.4,
        "rms radii",
        "distance from which dipoles of a cell are one: an error of a hundredth of the near field",
    )
    smoothing: float = number(
        1.0, "distances between points", "length over which the gradient of the winding number is smoothed"
    )
    inverted: float = number(0.1, "1", "winding number below minus this shows that a wall is inside out")
    least_slope: float = number(
        0.4, "1", "smallest slope of a level set that still shows a side: 1 where it is a distance"
    )
    slope_step: float = number(1.5, "spacings", "step to both sides over which the slope of phi is taken")
    prior_near: float = number(
        0.4, "clips", "distance within which points take their side from the moved prior: 2 mm"
    )
    prior_cell: float = number(
        0.15, "rms radii", "width of the cells in which the prior's wall is one dipole each"
    )
    prior_distance: float = number(
        2.5, "distances between points", "distance from all points beyond which the prior's wall counts"
    )

    def of_template(self) -> NormalSettings:
        """Return these settings for a template, whose walls often look elsewhere: any normal can show that,
        and each is taken as it is.
        """
        return replace(self, flat=1.0, most_tilt=0.0)


@dataclass(frozen=True)
class AmplitudeSettings:
    """These settings say what the field's deviation is before points are seen, place by place."""

    ladder: tuple[float, ...] = number(
        (0.001, 0.003, 0.006, 0.012, 0.025, 0.05),
        "rms radii",
        "amplitudes of the field that are tried: from hardly any to 1.6 mm",
    )
    noise_factors: tuple[float, ...] = number(
        (0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 2.0, 3.0),
        "1",
        "factors on the motion's noise that are tried with each amplitude",
    )
    neighbours: int = number(12, "points", "neighbours that predict a point")
    most_points: int = number(4000, "points", "most points that are predicted from their neighbours")
    around: int = number(60, "points", "nearest points that decide on the amplitude at a place")
    reach: float = number(
        0.25, "rms radii", "distance over which a point has a say in the amplitude at a place: 7 mm"
    )
    iterations: int = number(20, "", "iterations of finding how often each amplitude occurs")
    least_share: float = number(0.001, "1", "smallest share of the places that each amplitude has")


@dataclass(frozen=True)
class ReconstructionSettings:
    """These are all numbers of the reconstruction."""

    evidence: float = number(
        15.0, "nats", "gain in predicting left-out points that a reconstruction needs: chance makes up to ten"
    )
    field_evidence: float = number(
        10.0, "nats", "gain near the moved prior alone that is enough too: chance makes up to seven"
    )
    least_points: int = number(
        50, "points", "fewest believed points for a reconstruction: fewer show no wall by themselves"
    )
    folds: int = number(4, "", "parts of the points, each predicted by the others")
    newton_steps: int = number(
        3, "", "steps of Newton's method from the moved prior to the wall whose density of points is asked"
    )
    most_faces: int = number(
        100_000, "faces", "faces above which that wall is not divided further to be finer than the noise"
    )
    most_training: int = number(2000, "points", "most points that predict the others")
    rounds_of_template: int = number(
        2, "", "rounds of finding which points touch, with a template: its motion ends millimetres off"
    )
    rounds_inside: int = number(3, "", "most rounds of adding points that are known to be inside")
    around: float = number(
        0.8, "clips", "distance from a point within which phi is computed, though far off the moved prior"
    )
    around_between: float = number(
        1.2, "distances between points", "smallest distance from a point within which phi is computed"
    )
    bare_between: float = number(
        1.5,
        "distances between points",
        "distance to the nearest point beyond which the field fades",
    )
    fading: float = number(
        1.0, "clips", "length, beyond `bare_between`, over which the field fades to the moved prior"
    )
    neck: float = number(
        0.6, "distances between points", "half width of necks that may be gaps between points"
    )
    widest_neck: float = number(
        0.09, "rms radii", "largest half width of necks that may be gaps between points: 3 mm"
    )
    expected: float = number(
        10.0, "points", "points that a part on a neck must have room for before it can lack them"
    )
    supported: float = number(0.25, "1", "share of wall near points, above which a part on a neck is wall")
    around_neck: int = number(
        4, "points", "fewest points on the wall around a neck for the part behind it to be taken away"
    )
    cut_smoothing: float = number(
        1.0, "spacings", "sd of the average that takes the lattice's steps off cuts"
    )
    deviation_points: int = number(10, "points", "nearest points that determine the deviation of a vertex")
    absent: float = number(0.02, "1", "share of a patient's own wall that is absent, before points are seen")
    absent_of_template: float = number(
        0.08, "1", "share of a template's wall that is absent, before points are seen: veins differ"
    )
    absent_length: float = number(0.75, "rms radii", "length of parts that may be absent: a vein of 20 mm")
    unmapped: float = number(
        1.5, "distances between points", "distance to the nearest point above which wall was not visited"
    )
    curved: CurvedWallSettings = field(default_factory=CurvedWallSettings)
    splines: SplineSettings = field(default_factory=SplineSettings)
    normals: NormalSettings = field(default_factory=NormalSettings)
    amplitude: AmplitudeSettings = field(default_factory=AmplitudeSettings)
    surplus: SurplusSettings = field(default_factory=SurplusSettings)
    own_parts: OwnPartSettings = field(default_factory=OwnPartSettings)
    handles: HandleSettings = field(default_factory=HandleSettings)
