"""What a level-set stage reaches: phi, the wall that it stands for, and what is said of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..arrays import Array
from ..geometry.components import component_areas, components_and_euler
from ..geometry.surface import Surface
from ..run_warning import RunWarning
from .grid.distance import SignedDistance
from .repair import Crossing


@dataclass(frozen=True, eq=False)
class Result:
    """A result has a level set phi, the wall that it is the signed distance of (with fields per vertex,
    unless `fields` tells them), how it was reached, and the noise, None where nothing found it.
    """

    phi: SignedDistance
    wall: Surface
    sigma: float | None
    status: str
    converged: bool = True
    trace: tuple[Mapping[str, float], ...] = ()
    warnings: tuple[RunWarning, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)
    weights: Array | None = None  # (n,) probabilities of contact of the points, where they were asked again
    fields: Callable[[Array], dict[str, Array]] | None = None  # values (n,) at places (n, d) of the wall
    exact: bool = False  # whether the wall is the zero set of phi, face by face
    unchanged: bool = False  # whether nothing was added to the moved prior
    valid: bool = False  # whether the wall is a mesh that need not be made anew
    # whether components beside the largest belong to the result: those of the wall, or what the paper's
    # forces cut off
    islands: bool = False

    @property
    def smallest(self) -> float:
        """Area of the wall's smallest component, over that of its largest; 1 where no other than the largest
        stays.
        """
        if not self.islands:
            return 1.0
        _, areas = component_areas(self.wall)
        return float(areas.min() / areas.max())

    def faults(self, mesh: Surface, crossing: Crossing) -> tuple[RunWarning, ...]:
        """Return a warning where a mesh of phi has another topology than the wall; none where islands belong
        to the result.
        """
        found = components_and_euler(mesh.vertices, mesh.faces)
        meant = components_and_euler(self.wall.vertices, self.wall.faces)
        if found == meant or (self.islands and meant[0] == 1):
            return ()
        why = (
            "it intersects itself, and walls were merged there"
            if crossing(self.wall).any()
            else "walls are closer than the grid resolves; try a smaller spacing"
        )
        return (
            RunWarning(
                "mesh-differs",
                f"the mesh has {_describe_topology(*found)}, "
                f"the moved prior {_describe_topology(*meant)}: {why}",
            ),
        )


def _describe_topology(components: int, euler: int) -> str:
    return f"{components} component{'s' * (components != 1)} (Euler number {euler})"
