"""Numbers of the level set: how points are seen from a wall, which corrections they ask for, the lattice."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..noise.settings import ContactSettings
from ..settings import number
from .reconstruction.settings import ReconstructionSettings


@dataclass(frozen=True)
class ObservationSettings:
    """How points are seen from a wall that moves along its normals."""

    sigma_log_sd: float = number(0.5, "1", "of a noise level that no earlier stage has found")
    least_outliers: float = number(
        0.02, "1", "a smaller fraction is not believed, but for 0: then all touch,"
    )
    most_outliers: float = number(0.3, "1", "nor a larger one: corrections would hear too few")
    exact_noise: float = number(4e-6, "rms radii", "noise of points that lie on the surface as it is")
    most_curvature: float = number(5.0, "1 / rms radii", "larger curvatures are noise of the mesh")
    most_bias: float = number(0.6, "1", "noise times curvature beyond which the bias is not to be trusted")
    contact: ContactSettings = field(default_factory=ContactSettings)


@dataclass(frozen=True)
class FieldSettings:
    """How a field is looked for in residuals: a grid of amplitudes and noise levels, on few rows."""

    most_rows: int = number(600, "rows", "more points share rows by patches of the surface")
    patches: float = number(3.0, "1 / lengths", "patches in a correlation length")
    amplitudes: tuple[float, float, int] = number(
        (0.1, 10.0, 28), "noise levels", "from, to, how many: a grid"
    )
    noise_logs: tuple[float, float, int] = number((-2.4, 0.6, 31), "1", "of factors on the noise, likewise")
    least_belief: float = number(0.1, "1", "points less likely to touch the wall say nothing of a field")


@dataclass(frozen=True)
class CorrectionSettings:
    """Which corrections along the normals are tried, and when they are found."""

    evidence: float = number(3.0, "nats", "that a field of corrections must earn")
    iterations: int = number(20, "", "most per descent")
    longest: float = number(1.2, "rms radii", "longest correlation length tried; the others are halves of it")
    lengths: int = number(10, "", "most correlation lengths tried")
    shortest: float = number(3.0, "spacings", "shorter fields are lost in the lattice")
    nodes_per_length: float = number(8.0, "nodes", "with 4 a field depends on where the lattice lies by 10 %")
    half_band: float = number(2.0, "nodes", "half width of a field's band: every foot has all its corners")
    as_good: float = number(2.0, "nats", "within which the longer of two fields is the better one")
    rounds: int = number(2, "", "times that the evidence sets amplitude and noise of a field")
    steady: float = number(0.15, "1", "change of their logarithms that asks for no further round")
    cooling: float = number(0.7, "1", "most that the noise falls by in a round: the wall is still to come")
    settled: float = number(0.05, "nats", "fall of the energy at which a descent ends")
    halvings: int = number(10, "", "of a step whose energy rises, before it is given up")
    solver_tolerance: float = number(1e-6, "1", "relative residual of a Gauss-Newton step")
    solver_iterations: int = number(2000, "", "most of conjugate gradients")


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
    few_closings: int = number(2, "", "of these for what a fold has pinched off, and for a correction")
    least_outside: float = number(0.3, "spacings", "of phi where merged walls were cut apart")
    fractions: tuple[float, ...] = number(
        (1.0, 0.5, 0.25, 0.0), "1", "of a correction that would tear or merge the surface"
    )


@dataclass(frozen=True)
class LevelSetSettings:
    """All numbers of the refinement of phi."""

    observation: ObservationSettings = field(default_factory=ObservationSettings)
    residual_field: FieldSettings = field(default_factory=FieldSettings)
    correction: CorrectionSettings = field(default_factory=CorrectionSettings)
    lattice: LatticeSettings = field(default_factory=LatticeSettings)
    reconstruction: ReconstructionSettings = field(default_factory=ReconstructionSettings)


@dataclass(frozen=True)
class PaperSettings:
    """Discretisation of the paper's formulation."""

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
