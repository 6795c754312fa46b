"""Numbers of the level set: the lattice, and the paper's formulation."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import number


@dataclass(frozen=True)
class LatticeSettings:
    """How phi is kept whole on a lattice."""

    half_band: float = number(3.0, "spacings", "half width of the band of phi")
    thin_band: float = number(
        2.0, "spacings", "the same where only the zero set matters: more than the diagonal of a cell"
    )
    joint: float = number(0.5, "cell diagonals", "half the thickness of a sheet that the lattice cannot miss")
    closings: tuple[float, ...] = number(
        (0.5, 1.0, 2.0, 3.0), "spacings", "radii tried to close what runs into itself, the least first"
    )
    few_closings: int = number(2, "", "of these where a fold has pinched something off")
    least_outside: float = number(0.3, "spacings", "of phi where merged walls were cut apart")


@dataclass(frozen=True)
class PaperSettings:
    """Discretisation of the paper's formulation."""

    exact_noise: float = number(4e-6, "rms radii", "noise of points that lie on the prior as it is")
    delta_width: float = number(
        2.0, "spacings", "half width of delta and Heaviside: whole, to keep their sums"
    )
    half_band: float = number(5.0, "spacings", "half width of the band")
    free: float = number(
        3.0, "spacings", "phi moves so near to the surface: its zero set never meets the border"
    )
    steps: int = number(10, "", "between two reinitialisations")
    settled: float = number(
        1e-4, "1", "relative fall of the energy between two of them that ends the descent"
    )
    solver_tolerance: float = number(1e-6, "1", "relative residual of an implicit step")
    solver_iterations: int = number(500, "", "most of conjugate gradients")
