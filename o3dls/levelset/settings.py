"""Numbers of the level set: the lattice, and the paper's formulation."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import number


@dataclass(frozen=True)
class LatticeSettings:
    """These settings say how phi is kept whole on a lattice."""

    half_band: float = number(3.0, "spacings", "half width of the narrow band of phi")
    thin_band: float = number(
        2.0, "spacings", "half width where only the zero set matters: more than the diagonal of a cell"
    )
    joint: float = number(
        0.5, "cell diagonals", "half the thickness of joined walls: a sheet that the lattice cannot miss"
    )
    closings: tuple[float, ...] = number(
        (0.5, 1.0, 2.0, 3.0),
        "spacings",
        "radii of closings tried where the wall runs into itself, smallest first",
    )
    few_closings: int = number(2, "", "number of `closings` tried before islands are removed")
    most_rings: int = number(
        2, "rings", "rings of vertices about folded faces that are relaxed: more would smooth a part"
    )
    least_outside: float = number(
        0.3, "spacings", "value that phi gets at least where a wall is cut or taken away"
    )


@dataclass(frozen=True)
class PaperSettings:
    """These settings discretise the paper's formulation."""

    delta_width: float = number(
        2.0, "spacings", "half width of delta and Heaviside: a whole number, to keep their sums"
    )
    half_band: float = number(5.0, "spacings", "half width of the narrow band of phi")
    free: float = number(
        3.0,
        "spacings",
        "distance from the surface within which phi moves: the zero set never meets the border",
    )
    steps: int = number(10, "", "steps of the descent between two reinitialisations")
    settled: float = number(
        1e-4, "1", "relative fall of the energy per reinitialisation below which the descent ends"
    )
    solver_tolerance: float = number(1e-6, "1", "relative residual at which an implicit step is solved")
    solver_iterations: int = number(500, "", "most iterations of conjugate gradients in an implicit step")
