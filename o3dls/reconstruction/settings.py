"""Numbers of the reconstruction."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..settings import number


@dataclass(frozen=True)
class SplineSettings:
    """The field that is added to the moved prior's signed distance: B-splines on lattices, each half as wide
    as the one before.
    """

    coarsest: float = number(
        0.3, "rms radii", "lattice of the longest splines: 10 mm, about what a branch is wide"
    )
    finest_between: float = number(0.7, "distances between points", "finer splines would follow noise,")
    finest_noise: float = number(1.5, "noise levels", "for the same reason,")
    finest_spacing: float = number(1.5, "spacings", "or be lost in the lattice of phi")
    wall_finest_between: float = number(
        0.3, "distances between points", "the wall at last has finer ones: points with normals tell detail"
    )
    clip: float = number(
        0.15, "rms radii", "the prior's distance says no more beyond: 5 mm, as in truncated distances"
    )
    normal_sd: float = number(0.4, "1", "of a normal by the points around: 23 degrees")
    offsets: tuple[float, ...] = number(
        (0.09, 0.18),
        "rms radii",
        "3 and 6 mm off the wall the sign is known too, where points are off the moved prior:",
    )
    offset_noise: float = number(2.0, "noise levels", "this far,")
    offset_cosine: float = number(0.5, "1", "or with a normal so unlike the prior's")
    offset_neighbours: int = number(5, "points", "of which most must be so")
    covered: float = number(
        1.0, "distances between points", "to one on the wall in front: then points inside it are no wall"
    )
    sparse: float = number(
        4.0, "medians", "of wall that a point stands for: those that lie sparser inside are no wall either"
    )
    offset_sd: float = number(0.35, "offsets", "how well the distance is known there")
    offset_clear: float = number(0.7, "offsets", "distance to the nearest point that an offset needs")
    tolerance: float = number(1e-3, "1", "relative residual of conjugate gradients: 0.01 mm")
    iterations: int = number(300, "", "most of them")


@dataclass(frozen=True)
class NormalSettings:
    """Normals of points: planes through their neighbours, sides by the winding number."""

    radius: float = number(0.15, "rms radii", "of a neighbourhood: 5 mm, about a vein's radius,")
    radius_noise: float = number(4.0, "noise levels", "or so much: planes must not follow noise")
    thinning: float = number(
        0.33, "radii", "width of the cells of which a neighbourhood takes one point each"
    )
    least: int = number(12, "points", "in a neighbourhood, however far")
    most: int = number(64, "points", "in a neighbourhood")
    height_noise: float = number(
        1.4, "noise levels", "a point off the plane of the others by more shows that the wall turns there"
    )
    tree_neighbours: int = number(12, "points", "that a normal may agree with")
    rounds: int = number(10, "", "most of turning normals; it ends when none turns any more")
    rounds_again: int = number(2, "", "most where they were turned before, by other beliefs in the points")
    largest_area: float = number(4.0, "medians", "of wall that a point stands for: beyond it is unmapped")
    cell: float = number(0.06, "rms radii", "points this near share a dipole: 2 mm")
    far_cell: float = number(0.2, "rms radii", "cells of which all dipoles are one")
    far: float = number(0.4, "rms radii", "from this distance on: to a hundredth of the field next to it")
    smoothing: float = number(1.0, "distances between points", "of the winding number's gradient")
    inverted: float = number(0.1, "1", "less than minus this, a winding number tells a wall inside out")
    least_slope: float = number(0.4, "1", "of a level set that still tells a side: 1 where it is a distance")
    slope_step: float = number(1.5, "spacings", "to both sides, over which the slope of phi is taken")
    prior_near: float = number(0.4, "clips", "of points that take their side from the moved prior: 2 mm")
    prior_cell: float = number(0.15, "rms radii", "the prior's wall in cells of this width is a dipole each")
    prior_distance: float = number(2.5, "distances between points", "without points the prior's wall counts")


@dataclass(frozen=True)
class AmplitudeSettings:
    """The field's deviation before points are seen, place by place."""

    ladder: tuple[float, ...] = number(
        (0.001, 0.003, 0.006, 0.012, 0.025, 0.05), "rms radii", "that are tried: hardly any to 1.6 mm"
    )
    noise_factors: tuple[float, ...] = number(
        (0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 2.0, 3.0),
        "1",
        "on the noise that the motion found, with each",
    )
    neighbours: int = number(12, "points", "that predict a point")
    most_points: int = number(4000, "points", "that are predicted")
    around: int = number(60, "points", "that decide at a place")
    reach: float = number(0.25, "rms radii", "of their say: 7 mm")
    iterations: int = number(20, "", "of finding how often each occurs")
    least_share: float = number(0.001, "1", "of the places, that each has")


@dataclass(frozen=True)
class SurplusSettings:
    """Which parts of the moved prior points show not to be there."""

    cell: float = number(0.04, "rms radii", "of the lattice on which they are cut off: 1 mm")
    reach: float = number(1.0, "distances between points", "to the nearest point of a wall that has points")
    cosine: float = number(0.5, "1", "of a point's normal with a step that leads through its wall")
    covered: float = number(0.05, "1", "cost of new wall that has points, in that of wall without")
    unsupported: float = number(1.0, "1", "cost of wall without points that is there")
    sac: float = number(0.3, "1", "the same where that is asked: only what hangs on a narrow neck goes")
    support: float = number(10.0, "1", "cost of giving up wall with points")
    expected: float = number(1.0, "points", "that a part has room for, if it can lack them")
    largest: float = number(0.3, "1", "of the wall is such a part, at most: more was not visited")
    most: float = number(0.16, "1", "of the wall are all such parts, at most: more was not visited")
    supported: float = number(0.1, "1", "of its wall: with points on more it is there")
    severed: float = number(
        3.0, "points", "on wall that hangs on a part, from which the part is there: fewer span no surface"
    )
    closed: float = number(
        0.2, "1", "of its mouth has points, or it stays: a cut through unvisited wall has hardly one on it"
    )
    elsewhere: float = number(
        0.09, "1", "or with less of all wall but sacs without points, beyond chance: nothing is unmapped,"
    )
    fringe: float = number(0.8, "reaches / rms radius", "or, if it is less, so much: next to what is cut,")
    even: float = number(1.08, "1", "if points are spread as evenly: 1 at random, 1.2 and more in clusters")


@dataclass(frozen=True)
class OwnPartSettings:
    """When a part of the patient's own anatomy is given up: never because no catheter was there."""

    reach: float = number(1.0, "clips", "from the new wall, beyond which the prior's inside is a lost part")
    evidence: float = number(15.0, "nats", "by which points must be likelier without it: three that lie deep")


@dataclass(frozen=True)
class HandleSettings:
    """Which handles a reconstruction keeps, and how it gets rid of the others."""

    evidence: float = number(3.0, "nats", "by which points must be likelier with a handle than without")
    least_cut: float = number(
        0.009, "squared rms radii", "that cut a handle, for points to be asked: 8 mm^2; others are cut"
    )
    most_handles: int = number(6, "", "of which points are asked, those first whose cut is largest")
    most_parts: int = number(8, "", "of what the outside leaves out that may be no part of the tunnel")
    reach: float = number(4.0, "noises", "within which a place of the wall may have caused a point")
    floor: float = number(1e-4, "1 / noise", "density of points that no wall caused")


@dataclass(frozen=True)
class ReconstructionSettings:
    """All numbers of the reconstruction."""

    evidence: float = number(
        15.0, "nats", "by which left-out points are predicted better: chance makes up to ten"
    )
    field_evidence: float = number(
        10.0, "nats", "or by which those near the moved prior are: chance makes up to seven"
    )
    least_points: int = number(50, "points", "believed: fewer tell no wall by themselves")
    folds: int = number(4, "", "parts of the points that are predicted by the others")
    most_training: int = number(2000, "points", "that predict the others")
    rounds: int = number(3, "", "of finding who touches the wall")
    turns: int = number(1, "", "of the normals to those of phi")
    rounds_inside: int = number(3, "", "most of taking in points that are known to be inside")
    cluster: int = number(6, "points", "that together may be a wall that the motion did not believe")
    cluster_reach: float = number(1.5, "distances between points", "between neighbours in a cluster")
    covered: float = number(0.5, "1", "of a cluster in front of wall with points of its own: it is no wall")
    cluster_weight: float = number(0.9, "1", "probability that it touches, to begin with")
    around: float = number(0.8, "clips", "phi is wanted so near to a point, though far off the moved prior,")
    around_between: float = number(1.2, "distances between points", "or so near")
    bare: float = number(
        0.3, "clips", "outside the moved prior, from which the inside needs points around it"
    )
    bare_between: float = number(1.5, "distances between points", "to the nearest one, at most")
    fading: float = number(1.0, "clips", "farther from points, over which the field fades to the moved prior")
    neck: float = number(0.6, "distances between points", "half as wide necks hang by gaps between points,")
    widest_neck: float = number(0.09, "rms radii", "but no wider than 3 mm")
    expected: float = number(10.0, "points", "that a part has room for, if it can lack them")
    supported: float = number(0.25, "1", "of its wall near points, as next to a neck: with more it is wall")
    around_neck: int = number(
        4, "points", "that lie on the wall around the neck of a part that is taken away"
    )
    least_outside: float = number(0.3, "spacings", "of phi where something was taken away")
    cut_smoothing: float = number(
        1.0, "spacings", "sd of the average that takes the lattice's steps off cuts"
    )
    deviation_points: int = number(10, "points", "that the deviation of a vertex is asked of")
    absent: float = number(0.02, "1", "of a patient's own wall, before points are seen, is not there")
    absent_of_template: float = number(
        0.08, "1", "of a template's wall, before points are seen, is not there: veins differ"
    )
    absent_length: float = number(0.75, "rms radii", "of parts that may be absent: a vein of 20 mm")
    unmapped: float = number(1.5, "distances between points", "to the nearest one, of wall not visited")
    splines: SplineSettings = field(default_factory=SplineSettings)
    normals: NormalSettings = field(default_factory=NormalSettings)
    amplitude: AmplitudeSettings = field(default_factory=AmplitudeSettings)
    surplus: SurplusSettings = field(default_factory=SurplusSettings)
    own_parts: OwnPartSettings = field(default_factory=OwnPartSettings)
    handles: HandleSettings = field(default_factory=HandleSettings)
