"""Stage `recorded`: the pose that the case came with, such as a mapping system's own registration, as one
more estimate.
"""

from __future__ import annotations

from typing import ClassVar

from ..case import Case
from ..errors import InputError
from ..estimate import Estimate
from ..plugins.stage import Stage


class Recorded(Stage):
    """Place the prior by the 4x4 matrix recorded in the case (init.csv), to compare with."""

    name: ClassVar[str] = "recorded"
    finds_pose: ClassVar[bool] = True

    def obstacle(self, case: Case) -> str | None:
        return None if case.init is not None else "the case has no init.csv with a recorded pose"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        if case.init is None:
            raise InputError(f"case {case.name}: {self.obstacle(case)}")
        return Estimate(case.prior.transformed(case.init), case.init, "pose recorded in init.csv")
