"""The interface of a stage: `(case, estimate) -> estimate`."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, ClassVar

from pydantic import Field

from ..case import FITTED_TYPES, Case
from ..estimate import Estimate
from .plugin import Plugin

FINEST = 1e-3  # mm: no image and no surface of a heart has detail of a micrometre


class Stage(Plugin):
    """A stage is one step of a pipeline. `as_` names its estimate (default: the stage's name); `after` names
    the estimate to start from.
    """

    placing: ClassVar[frozenset[str]] = frozenset({"as_", "after"})
    finds_pose: ClassVar[bool] = (
        False  # True: needs no rough pose, so points far from the prior are no mistake
    )

    as_: Annotated[  # type checkers would take an alias behind the equals sign for the only name in Python
        str | None,
        Field(
            alias="as",
            # it is also the name of files, which systems limit to 255 bytes
            pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,59}$",
            description="name of the estimate; default: the stage's name",
        ),
    ] = None
    after: str | None = Field(default=None, description="estimate to start from; default: the stage before")

    @property
    def estimate_name(self) -> str:
        return self.as_ or self.name

    @property
    def fits(self) -> tuple[str, ...]:
        """Types of the points that the stage is given; it cannot see any other point, nor the truth."""
        return FITTED_TYPES

    @abstractmethod
    def __call__(self, case: Case, start: Estimate) -> Estimate:
        """Return a new estimate; neither argument is changed."""
