"""Warnings of a run: a code to decide by, a sentence to read, and the stage that they come from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

CODES: Mapping[str, str] = {
    # the start of a run
    "start-pose-doubtful": "another pose fits the points clearly better than the start pose",
    "component-without-points": "a component of the prior has no point near it",
    "points-on-a-ball": "the points lie on a ball rather than on the prior",
    "points-beside-the-wall": "nearly all points lie on one side of the prior where the landmarks put it",
    "large-noise": "the points scatter more about the wall than mapping does",
    "small-noise": "the points scatter less about the wall than any catheter's do",
    "landmark-not-used": "one landmark contradicts all others, which agree, and is not used",
    "landmark-names-doubtful": "names of landmarks may mean either of two places, and are not used",
    "values-missing": "a column of the points holds numbers that stand for none, as -10000 does",
    # poses
    "weak-direction": "the points do not determine the pose in one direction",
    "uncertain-pose": "the pose search found another pose that is almost as good",
    "prior-reduced": "the prior has more faces than a fit can use, and was reduced",
    # the end of a run
    "points-far-off": "held-out points, ablation sites or landmarks lie centimetres from the result",
    # motion: the case
    "crumpled-prior": "the prior has folds near every point",
    "small-components": "the prior has small components that points may be taken to lie on",
    "landmark-swapped-place": "a landmark was measured near the place of another landmark",
    "no-landmark-start": "several starts were asked for, and the landmarks give none",
    "duplicate-points": "several points share one place and count once",
    "sigma-range": "the column sigma spans too wide a range",
    "sigma-missing": "some points have no sigma",
    # motion: the result
    "many-outliers": "more than half of the points are judged to be outliers",
    "captured-points": "points far from the wall at the start lie on it after the motion",
    "stretched-wall": "a part of the wall is stretched to twice its length or more",
    "volume-changed": "the motion changes the volume more than a heartbeat can",
    "prior-of-another": "the motion bends the prior as into another person's heart",
    "alternative-start": "another start leads to another surface that is almost as probable",
    "alternative-points": "a fit without some points leads to another surface that is almost as probable",
    "map-shift": "one part of the map seems to be shifted as a whole, as if the patient had moved",
    "errors-together": "points that were taken one after the other have an error in common",
    "order-lost": "the points are in no order of a path, and the wall may hold errors that they share",
    "outdated-amplitudes": "many points were added after amplitudes and noise were estimated",
    # topology
    "topology-changed": "a part of the prior was removed, or a tube added",
    # level set
    "self-intersection-repaired": "the moved prior intersects itself and was repaired",
    "mesh-differs": "the mesh has another topology than the moved prior",
    "parts-lost": "parts of the moved prior are missing in the mesh",
    # the end of a run
    "stage-rejected": "the last estimate is farther from left-out points than an earlier one, which is final",
    "stage-kept": "the last estimate is farther from left-out points than an earlier one, and kept",
    # a stage of another package
    "other": "a stage outside of o3dls gives this warning; its sentence says what it means",
}


Grade = Literal["good", "amber", "bad"]
# what a verdict is at best beside a warning; the others inform of what was done, of what is missing, or of
# what a check of its own grades by its amount (removed wall, far points)
GRADES: Mapping[str, Grade] = {
    "start-pose-doubtful": "amber",
    "component-without-points": "amber",
    "points-on-a-ball": "bad",
    "points-beside-the-wall": "amber",
    "large-noise": "amber",
    "uncertain-pose": "amber",
    "crumpled-prior": "amber",
    "landmark-not-used": "amber",
    "landmark-swapped-place": "amber",
    "sigma-range": "amber",
    "many-outliers": "bad",
    "stretched-wall": "amber",
    "volume-changed": "amber",
    "alternative-start": "amber",
    "alternative-points": "amber",
    "map-shift": "amber",
    "outdated-amplitudes": "amber",
    "mesh-differs": "amber",
    "stage-rejected": "amber",
    "stage-kept": "amber",
    "other": "amber",
}


@dataclass(frozen=True)
class RunWarning:
    """A warning has a `code`, one of CODES, a `sentence` for people, and the `stage` that names its estimate.

    The pipeline fills in the stage when it stores the estimate. Raises ValueError for an unknown code.
    """

    code: str
    sentence: str
    stage: str = ""

    def __post_init__(self) -> None:
        if self.code not in CODES:
            raise ValueError(f"no warning code '{self.code}': o3dls.run_warning.CODES lists them")

    def __str__(self) -> str:
        return self.sentence

    @property
    def grade(self) -> Grade:
        """What a verdict is at best beside it: good for information, amber for a doubt, bad for a failure."""
        return GRADES.get(self.code, "good")

    @property
    def kind(self) -> str:
        """What it is called: a warning puts the result in doubt, a note only informs."""
        return "note" if self.grade == "good" else "warning"

    def record(self) -> dict[str, str]:
        """The warning as run.json holds it."""
        return {"code": self.code, "stage": self.stage, "sentence": self.sentence}


def of_stage(warnings: Iterable[RunWarning], stage: str) -> tuple[RunWarning, ...]:
    """The warnings, with the name of a stage where they do not have one yet."""
    return tuple(warning if warning.stage else replace(warning, stage=stage) for warning in warnings)


def each_once(warnings: Iterable[RunWarning]) -> tuple[RunWarning, ...]:
    """The warnings in order without repeats: a stage hands on those of the stages before it."""
    return tuple(dict.fromkeys(warnings))
