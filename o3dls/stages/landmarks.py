"""Stage `landmarks`: the pose that brings named landmarks of the prior onto the measured ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from ..arrays import Array
from ..case import Case
from ..errors import InputError, did_you_mean
from ..estimate import Estimate
from ..geometry.similarity import fit_similarity, rms_radius
from ..plugins.stage import Stage
from ..registration.landmarks import determined

if TYPE_CHECKING:
    from ..registration.landmarks import Reading

FEWEST_POINTS = 10  # fewer do not judge a pose
ANOTHER_SIZE = (
    "the landmarks say that the prior is {:.2g} times as large as the map, by one factor for all of them: "
    "was its unit or the size of its voxels lost? Scale the prior and its landmarks, and leave the names"
)


class Landmarks(Stage):
    """Align the prior by its named landmarks (least squares, Umeyama 1991), rigidly or with scale."""

    name: ClassVar[str] = "landmarks"
    scale: bool = Field(
        default=False,
        description="estimate the scale too; four ostia with 2 mm error determine it to about 5 %",
    )
    weights: dict[str, float] = Field(
        default_factory=dict,
        description="weight of a landmark by name; default 1",
        json_schema_extra={"unit": "1"},
    )

    def obstacle(self, case: Case) -> str | None:
        names, _, _ = case.landmark_pairs()
        if len(names) >= case.dimension:
            return None
        needed = f"at least {case.dimension} are needed in {case.dimension}D"
        doubtful = "".join(f"; {said}" for said in case.landmark_doubts())
        return (
            f"{len(names) or 'no'} landmark pairs: {needed}; name them in points.csv and prior_landmarks.csv"
            + doubtful
        )

    def mistake(self, case: Case) -> str | None:
        names, prior, measured = case.landmark_pairs()
        for points, file in ((prior, "prior_landmarks.csv"), (measured, "points.csv")):
            if not determined(points):
                where = f"the landmarks {', '.join(names)} of {file} lie on one line"
                return f"{where} and leave a rotation undetermined; add one that is not on the line"
        for name, weight in self.weights.items():
            if name not in names:
                return f"weights: no landmark pair '{name}'{did_you_mean(name, names)}"
            if not weight > 0.0:
                return f"weights: {name} = {weight}: must be above 0"
        return None

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        from ..evaluation.trusted_landmarks import contradicted, describe_unused
        from ..registration.landmarks import errors, leave_one_out, readings

        if why := self.obstacle(case) or self.mistake(case):
            raise InputError(f"case {case.name}: {self.name}: {why}")
        names, prior, measured = case.landmark_pairs()
        weights = np.array([self.weights.get(name, 1.0) for name in names])
        found = readings(prior, measured, weights, scale=self.scale)
        _refuse_swapped(case, names, measured, found, scaled=self.scale)
        T_map_prior, rms, unused = found[0].T_map_prior, found[0].rms, ""
        if (odd := contradicted(case)) is not None:
            weights[odd] = 0.0
            T_map_prior = fit_similarity(prior, measured, weights, scale=self.scale)
            rms = float(np.sqrt(np.average(errors(prior, measured, T_map_prior) ** 2, weights=weights)))
            unused = f"; {describe_unused(case, odd)}"
        pairs = int((weights > 0.0).sum())
        misses = errors(prior, measured, T_map_prior)
        alone = leave_one_out(prior, measured, weights, scale=self.scale)
        kind = "similarity" if self.scale else "rigid motion"
        return Estimate(
            surface=case.prior.transformed(T_map_prior),
            T_map_prior=T_map_prior,
            status=(
                f"{kind} from {pairs} landmarks, rms {rms:.2f} "
                f"{case.units}{unused or _name_worst(names, alone, case.units)}"
            ),
            iterations=1,
            sigma=rms,
            trace=({"pairs": pairs, "rms": rms},),
            facts={"landmarks": _tabulate_errors(names, misses, alone)},
        )


def _refuse_swapped(
    case: Case, names: list[str], measured: Array, found: list[Reading], *, scaled: bool
) -> None:
    """Raise InputError where landmarks and points show that names are swapped or the prior is mirrored; many
    beats of one contact, which any pose may happen to bring to the wall, count once.
    """
    from ..noise.duplicates import wall_places
    from ..registration.global_pose import robust_costs
    from ..registration.landmarks import better_reading, explaining_scale
    from ..registration.match import SurfaceMatcher

    points = case.points.of("eam").xyz
    points = points[wall_places(points, rms_radius(case.prior.vertices))[0]] if len(points) else points
    surface = SurfaceMatcher(case.prior)

    def costs(reading: Reading) -> Array:
        return robust_costs(surface.match(points, reading.T_map_prior).distances, surface.radius)

    wrong = better_reading(
        found, rms_radius(measured), costs if len(points) >= FEWEST_POINTS else None, points
    )
    if wrong is None:
        return
    if not scaled and (factor := explaining_scale(case.landmark_pairs()[1], measured)) != 1.0:
        raise InputError(
            f"case {case.name}: {ANOTHER_SIZE.format(1.0 / factor)}, or say landmarks.scale = true"
        )
    what, remedy = [], []
    if wrong.exchanged:
        what.append(f"the landmarks {' and '.join(names[i] for i in wrong.exchanged)} seem to be swapped")
        remedy.append("correct the names in points.csv or prior_landmarks.csv")
    if wrong.mirrored:
        what.append("the prior seems to be mirrored")
        remedy.append("flip one axis of the prior and of its landmarks")
    gain = (
        f"rms error {found[0].rms:.3g} {case.units} as named, {wrong.rms:.3g} {case.units} otherwise, "
        "where the points fit better too"
    )
    raise InputError(f"case {case.name}: {' and '.join(what)} ({gain}): to fix this, {' and '.join(remedy)}")


def _name_worst(names: list[str], alone: Array, units: str) -> str:
    if np.isnan(alone).all():
        return ""
    worst = int(np.nanargmax(alone))
    return f"; worst when left out: {names[worst]}, off by {alone[worst]:.2f} {units}"


def _tabulate_errors(names: list[str], misses: Array, alone: Array) -> dict[str, Any]:
    return {
        name: {"error": float(miss), "leave_one_out": None if np.isnan(out) else float(out)}
        for name, miss, out in zip(names, misses, alone, strict=True)
    }
