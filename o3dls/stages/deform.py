"""Stage `deform`: the smooth non-rigid motion T of the prior, with its posterior; amplitudes and noise set by
the evidence.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator

from ..arrays import Array
from ..case import FITTED_TYPES, Case, Points
from ..errors import InputError, SolverError
from ..estimate import Estimate
from ..geometry.similarity import apply, fit_similarity, rms_radius
from ..geometry.surface import Surface
from ..plugins.stage import Stage
from ..registration.landmarks import determined

if TYPE_CHECKING:
    from ..motion.observations import Data
    from ..motion.problem import MotionProblem
    from ..motion.settings import MotionSettings

VEIN = re.compile(r"(?<![A-Z])[LR][SI]PV(?![A-Z])")
NEVER = 1e-250  # odds of being off the wall that no residual outweighs, and whose logarithm is still a number
NO_WALL = 0.95  # share of the points off the wall that leaves no wall
GROWS = 3.0  # factor on the volume that no heartbeat has: a ventricle keeps a third at least
WRONG = "start, scale, frame or landmarks may be wrong"
WON_OVER = (
    0.05  # share of points off the wall at the start that a motion makes touch: .04 is the most of good fits
)
# distance of a landmark from its own place over that from another's: 0.9 is the most among good ones, 2.6 the
# least of wrong
MISNAMED = 2.0
# share of a prior's area that its smooth wall has: patients' have .94 and more, stairs of label volumes .79
SMOOTH = 0.7
OUTGROWN = (
    1.1  # points over those that a fit from nothing had: what it found of them all may be another by now
)
UNITS_APART = 100.0  # no map has points a hundred times as good as others; a column in two units has
CLOSE = 3.0  # nats: a surface whose evidence is within a factor of 20 of the best is no worse a guess


class Deform(Stage):
    """Fit a similarity, strains and a smooth motion field, robustly. Lengths are in rms radii of the prior:
    26 mm for an atrium.
    """

    name: ClassVar[str] = "deform"
    vector: tuple[float, ...] = Field(
        (1.15, 0.46),
        min_length=1,
        description="correlation lengths of the vector field",
        json_schema_extra={"unit": "rms radii"},
    )
    normal: tuple[float, ...] = Field(
        (0.46,),
        description="correlation lengths of the field along the normal",
        json_schema_extra={"unit": "rms radii"},
    )
    landmarks: bool = Field(
        True,
        description=(
            "fit the named landmarks too, with a noise level of their own, and let what lies "
            "around each move on its own"
        ),
    )
    ablation: Literal["hold_out", "fit"] = Field(
        "hold_out", description="fit ablation points, with a noise level of their own, or hold them out"
    )
    bends: Literal["upright", "any"] = Field(
        "upright",
        description=(
            "expect an atrium to bend between bottom and top, where the names of veins tell "
            "these, or any way alike"
        ),
    )
    outliers: Literal["doubt", "believe"] = Field(
        "doubt",
        description="doubt points that seem to lie off the wall, or believe every point as if none could",
    )
    contact_force: float = Field(
        5.0,
        gt=0.0,
        description="force at which a point is as likely to touch the wall as the mean point",
        json_schema_extra={"unit": "g"},
    )
    spread: float = Field(
        1.0,
        gt=0.0,
        description=(
            "how far the evidence may move the amplitude of a field: sd of its logarithm; half "
            "as far that of bends and noise"
        ),
        json_schema_extra={"unit": "1"},
    )
    odds: float = Field(
        0.0,
        description=(
            "log odds against a motion beyond the pose, before the points are seen; raise it for "
            "templates that hardly deform"
        ),
        json_schema_extra={"unit": "nats"},
    )
    roughness: Literal["mend", "keep"] = Field(
        "mend",
        description=(
            "smooth the prior where the points show that the wall lacks its roughness, or keep "
            "all of its detail"
        ),
    )
    starts: Literal["given", "several"] = Field(
        "given",
        description=(
            "fit from the given pose, or from those of the landmarks too, and keep what the evidence prefers"
        ),
    )
    iterations: int = Field(
        25, ge=15, description="most iterations; the evidence is asked three times in the first 14"
    )

    @field_validator("vector", "normal")
    @classmethod
    def _lengths(cls, lengths: tuple[float, ...]) -> tuple[float, ...]:
        if not all(0.0 < length < np.inf for length in lengths):
            raise ValueError("a correlation length must be above 0")
        return lengths

    @property
    def fits(self) -> tuple[str, ...]:
        return (*FITTED_TYPES, "ablation") if self.ablation == "fit" else FITTED_TYPES

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        data = observed(case, self)
        if not (data.group == 0)[~data.inside].any():
            raise InputError(f"deform: case {case.name} has no points of type eam")
        fits = [self._fitted(case, pose, data) for pose in self._poses(case, start)]
        best = min(fits, key=lambda estimate: float(estimate.fit.energy))
        said = [*_said(best, case.units), *_doubts(start, best), *_followed(best), *self._without_marks(case)]
        said += [
            *_rivals(best, fits, case.units),
            *_misnamed(case, start),
            *_crumpled(best.fit.problem),
            *_debris(case.prior),
            *_told(case.points.of(*self.fits), case.units),
        ]
        return replace(best, warnings=(*start.warnings, *said))

    def _poses(self, case: Case, start: Estimate) -> list[Array]:
        if self.starts == "given" or self._without_marks(case):
            return [start.T_map_prior]
        _, prior, measured = case.landmark_pairs()
        return [start.T_map_prior, *(fit_similarity(prior, measured, scale=scale) for scale in (False, True))]

    def _without_marks(self, case: Case) -> list[str]:
        """A sentence where several starts are asked for and the landmarks give none."""
        _, prior, measured = case.landmark_pairs()
        if self.starts == "given" or (determined(prior) and determined(measured)):
            return []
        return [
            'starts = "several": no three landmark pairs fix a pose, so that the given start was the only one'
        ]

    def _fitted(self, case: Case, pose: Array, data: Data, earlier: Estimate | None = None) -> Estimate:
        from ..motion.fit import fit_motion
        from ..motion.result import sentence

        fit = fit_motion(
            case.prior.vertices,
            case.prior.faces,
            pose,
            data,
            self.settings(),
            earlier.fit if earlier else None,
        )
        surface = replace(
            case.prior, vertices=fit.vertices, fields={**case.prior.fields, f"sd_{case.units}": fit.sd}
        )
        return Estimate(
            surface=surface,
            T_map_prior=fit.similarity,
            status=sentence(fit, case.units),
            converged=fit.converged,
            iterations=len(fit.trace),
            sigma=fit.sigma,
            weights=fit.weights,
            motion=fit.motion,
            trace=fit.trace,
            facts={**fit.facts, "tuned_on": earlier.facts["tuned_on"] if earlier else len(data.points)},
            fit=fit,
        )

    def update(self, case: Case, estimate: Estimate) -> Estimate:
        """An estimate of this stage after a few more points, in milliseconds: `case` has the points of
        before, and the new ones behind.

        Pose, amplitudes and noise levels stay; motion, posterior and beliefs take in the new points. Within
        0.05 mm in the mean of a fit from nothing after one point, where that would leave the amplitudes as
        they are; a tenth more points than these were found with are warned of. The column `sigma` compares
        new points with those of the estimate. Raises InputError where the estimate is not one of this stage,
        or prior, landmarks, parameters or the points of before have changed.
        """
        fit = estimate.fit
        if fit is None or estimate.motion is not fit.motion or not _same(fit.problem, case.prior):
            raise InputError(
                "update: the estimate must come from the stage 'deform' of this session, fitted to this prior"
            )
        before = fit.problem.data
        data = observed(case.visible(self.fits), self, before)
        if len(data.points) < len(before.points):
            raise InputError(
                f"update: {len(data.points)} points, fewer than the {len(before.points)} of the estimate"
            )
        if self.settings() != fit.problem.settings:
            raise InputError("update: the stage has other parameters than the one that made the estimate")
        changed = data.at(slice(len(before.points))).differs(before)
        if changed.any():
            raise InputError(
                f"update: point {np.argmax(changed)} is not what it was in the estimate (place, type, "
                "sigma, force), or the stage's "
                "contact_force or outliers are not; new points come behind the others"
            )
        if not (
            np.array_equal(data.marks_prior, before.marks_prior)
            and np.array_equal(data.marks_map, before.marks_map)
        ):
            raise InputError("update: the landmarks are not those of the estimate; fit it again")
        updated = self._fitted(case, estimate.T_map_prior, data, estimate)
        outdated = _said(estimate, case.units)
        kept = (warning for warning in estimate.warnings if warning not in outdated)
        return replace(updated, warnings=(*kept, *_said(updated, case.units)))

    def settings(self) -> MotionSettings:
        from ..motion.settings import MotionSettings

        usual = MotionSettings()
        return replace(
            usual,
            covariance=replace(
                usual.covariance,
                vector_lengths=self.vector,
                normal_lengths=self.normal,
                field_log_sd=self.spread,
            ),
            iteration=replace(usual.iteration, iterations=self.iterations),
            selection=replace(
                usual.selection,
                motion_log_odds=self.odds,
                smoothing_lengths=usual.selection.smoothing_lengths if self.roughness == "mend" else (),
            ),
        )


def _rivals(best: Estimate, fits: list[Estimate], unit: str) -> list[str]:
    """Sentences where another start, or one without some points, led to another surface that the points make
    almost as likely.
    """
    facts = best.facts
    rivals = list[tuple[str, float, float]]()
    for other in fits:
        apart = float(np.linalg.norm(other.surface.vertices - best.surface.vertices, axis=1).mean())
        rivals.append(("another start", other.fit.energy - best.fit.energy, apart))
    if "alternative_behind" in facts:
        without = (
            f"a fit that begins without {facts['alternative_excluded']:.0f} points that may have "
            "pulled the wall out"
        )
        rivals.append((without, facts["alternative_behind"], facts["alternative_apart"]))
    told = dict[str, str]()
    for name, behind, apart in rivals:
        if behind < CLOSE and apart > best.fit.state.scales.noises[0]:
            elsewhere = (
                f"({max(behind, 0.0):.1f} nats less), puts the vertices {apart:.1f} {unit} "
                "elsewhere on average"
            )
            told.setdefault(name, f"{name}, almost as likely {elsewhere}")
    return list(told.values())


def _said(found: Estimate, unit: str) -> list[str]:
    """Sentences on the points, in a fit or an update. Raises SolverError where hardly one of them is on the
    wall.
    """
    return [*_repeated(found.fit.problem.data, unit), *_off_wall(found), *_outgrown(found)]


def _off_wall(found: Estimate) -> list[str]:
    off = found.facts["outlier_fraction"]
    if off > NO_WALL:
        raise SolverError(f"deform: {found.status}: the points are not of this surface, or {WRONG}")
    return [f"{off:.0%} of the points are judged to be off the wall: {WRONG}"] if off > 0.5 else []


def _outgrown(found: Estimate) -> list[str]:
    """A sentence where many points came after a fit, which might find other amplitudes, noise and pose with
    them.
    """
    before = found.facts["tuned_on"]
    now = len(found.fit.problem.data.points)
    return (
        [f"amplitudes, noise and pose are those of the first {before} of {now} points: fit again"]
        if now > OUTGROWN * before
        else []
    )


def _doubts(start: Estimate, found: Estimate) -> list[str]:
    """A sentence on a motion that can hardly be meant. Raises SolverError where it is none of this prior."""
    grown = found.surface.volume / start.surface.volume
    if grown <= 0.0:
        raise SolverError(f"deform: the motion turns the surface inside out: {WRONG}")
    if 1.0 / GROWS < grown < GROWS:
        return []
    return [f"the motion makes what the surface encloses {grown:.2g} times as large: {WRONG}"]


def _followed(found: Estimate) -> list[str]:
    """Sentences on a wall that seems to follow points which are not of it."""
    from ..motion.leverage_points import captured_points, stretched_faces

    fit = found.fit
    said = list[str]()
    usual = fit.problem.settings.leverage
    touch = captured_points(fit.problem, fit.state)
    if touch.sum() > usual.captured_points and touch.mean() > WON_OVER:
        touching = (
            f"{touch.mean():.0%} of the points lie far off the wall at the start, and on it after the motion"
        )
        said.append(f"{touching}: does it follow points that float, or something that the prior lacks?")
    rest = found.surface.with_vertices(fit.motion.rest.at)
    long, share = stretched_faces(rest, found.surface.vertices, usual)
    if share > usual.stretched_area:
        middle = ", ".join(f"{x:.0f}" for x in found.surface.vertices[rest.faces[long]].mean(axis=(0, 1)))
        stretched = (
            f"{share:.0%} of the wall gets more than {usual.stretch:g} times as long, around ({middle})"
        )
        said.append(f"{stretched}: are the points there of this chamber?")
    return said


def _misnamed(case: Case, start: Estimate) -> list[str]:
    """A sentence for each landmark that lies far nearer to another's place on the posed prior than to its
    own.
    """
    names, prior, measured = case.landmark_pairs()
    apart = np.linalg.norm(measured[:, None] - apply(start.T_map_prior, prior)[None], axis=2)
    return [
        f"landmark {names[k]} lies {apart[k, k]:.0f} {case.units} from its place on the prior and "
        f"{apart[k, other]:.0f} from that of "
        f"{names[other]}: was it marked there?"
        for k, other in enumerate(apart.argmin(axis=1) if names else [])
        if MISNAMED * apart[k, other] < apart[k, k]
    ]


def _crumpled(problem: MotionProblem) -> list[str]:
    """A sentence where a fold of the prior is near wherever a point lies: distances to such a wall say little
    of noise and motion.
    """
    from ..geometry.differential import facing

    share = facing(problem.rest.at, problem.faces, problem.rest.normals)
    if share > SMOOTH:
        return []
    area = f"{1.0 / share:.2g} times the area of a smooth wall"
    return [
        f"the prior is crumpled ({area}): some fold of it is near every point, and noise and motion "
        "follow the folds; smooth it first"
    ]


def _told(points: Points, unit: str) -> list[str]:
    """Sentences on a column `sigma` that may not mean what it says."""
    sigma = points.numbers("sigma")
    told = sigma[np.isfinite(sigma)]
    if len(told) == 0:
        return []
    said = list[str]()
    blank = len(sigma) - len(told)
    if told.max() > UNITS_APART * told.min():
        said.append(f"sigma goes from {told.min():.2g} to {told.max():.2g}: is all of it in {unit}?")
    if blank:
        count = f"{blank} of {len(sigma)} points"
        said.append(
            f"{count} have no sigma: they count like the median of the others, "
            f"{points.typical_sigma:.2g} {unit}"
        )
    return said


def _debris(prior: Surface) -> list[str]:
    """A sentence where small pieces lie about the prior: whatever is nearest to a point may be its wall."""
    from ..geometry.components import SMALL_COMPONENT, component_areas

    _, areas = component_areas(prior)
    small = int((areas[areas > 0.0] < SMALL_COMPONENT * areas.max()).sum())
    some = f"{small} small pieces" if small > 1 else "a small piece"
    return [f"the prior has {some} that points may take for their wall: remove what is none"] if small else []


def _repeated(data: Data, unit: str) -> list[str]:
    """A sentence where mapping points share a place: they are no new evidence."""
    place = np.asarray(data.mapping)
    more = len(place) - len(np.unique(place))
    near = (
        f" or lie within {data.duplicate_distance:.2g} {unit} of it, too close for noise of their own"
        if data.duplicate_distance
        else ""
    )
    return (
        [f"{more} of {len(place)} points repeat the place of another{near}; each place counts once"]
        if more
        else []
    )


def _same(problem: MotionProblem, prior: Surface) -> bool:
    return np.array_equal(problem.faces, prior.faces) and np.array_equal(problem.vertices, prior.vertices)


def observed(case: Case, stage: Deform, before: Data | None = None) -> Data:
    """The fitted points as arrays: eam and inside points in noise group 0, ablation points in group 1,
    landmarks apart.

    `before`, the points of an earlier fit, tell what the points' own noise is relative to, and within what
    distance they are of one place.
    """
    from ..motion.observations import Data
    from ..noise.duplicates import distinct_places, duplicate_distance

    every = case.points.of(*stage.fits)
    near = (
        duplicate_distance(every.xyz, every.type, rms_radius(case.prior.vertices))
        if before is None
        else before.duplicate_distance
    )
    typical = every.typical_sigma if before is None or before.typical_sigma is None else before.typical_sigma
    rows, same = distinct_places(every.xyz, every.type, near)
    points = every.select(rows)
    _, marks_prior, marks_map = case.landmark_pairs()
    keep = slice(None) if stage.landmarks else slice(0)
    return Data(
        points=points.xyz,
        group=(points.type == "ablation").astype(np.int64),
        relative=every.relative_noise(typical)[rows],
        odds=_odds_of_floating(points, stage.contact_force) * (1.0 if stage.outliers == "doubt" else NEVER),
        inside=points.type == "inside",
        marks_prior=marks_prior[keep],
        marks_map=marks_map[keep],
        up=upwards(case.prior_landmarks) if stage.bends == "upright" else None,
        groups=1 + (stage.ablation == "fit"),
        mapping=same[every.type == "eam"],
        typical_sigma=typical,
        duplicate_distance=near,
    )


def upwards(landmarks: Mapping[str, Array]) -> Array | None:
    """Unit vector from the inferior to the superior pulmonary veins by their names (LSPV, LIPV, RSPV, RIPV);
    None where these are missing.

    Named by side, so that one side is enough and two sides count alike.
    """
    veins = {found[0]: at for name, at in landmarks.items() if (found := VEIN.search(name.upper()))}
    rises = [
        veins[f"{side}SPV"] - veins[f"{side}IPV"]
        for side in "LR"
        if {f"{side}SPV", f"{side}IPV"} <= set(veins)
    ]
    rise = np.sum(rises, axis=0)
    length = float(np.linalg.norm(rise))
    return np.asarray(rise / length) if length > 0.0 else None


def _odds_of_floating(points: Points, force: float) -> Array:
    """Factor on the odds of being off the wall: doubled for each `force` too little, halved for each too
    much, at most fourfold.
    """
    pressed = points.numbers("force")
    return np.where(np.isfinite(pressed), 2.0 ** np.clip((force - pressed) / force, -2.0, 2.0), 1.0)
