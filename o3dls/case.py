"""What is known before anything is fitted: the prior, points, landmarks; and, kept apart, the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, without_masked
from .columns import order_of
from .errors import InputError, did_you_mean
from .geometry.similarity import is_pose
from .geometry.surface import Surface
from .quantities import check_possible, known_values
from .registration.landmark_names import doubts, partners

UNITS = ("mm", "px")
MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 0.001, "in": 25.4, "px": 1.0}  # of files
SPACES = ("LPS", "RAS", "unknown")
# whose anatomy the prior is: the patient's own, or another person's or a mean anatomy
PRIOR_OF = ("patient", "template")
POINT_TYPES = ("eam", "ablation", "landmark", "inside")
FITTED_TYPES = ("eam", "inside")
# fields of a result, with the unit behind their names
OF_A_RUN = ("sd", "displacement", "correction", "distance_to_nearest_point")
WITHOUT_UNIT = ("prior_only", "existence")
BEST = 0.02  # least relative noise of a point: it holds the surface as firmly as one can


@dataclass(frozen=True, eq=False)
class Points:
    """Points are what was measured: xyz (n, d) in the map frame, type (n,), further columns (n,) by name
    (numbers, NaN = missing, or text); order (n,): when each was taken: by `time`, else as they come, and the
    same when some are left out. notes: sentences on numbers that stood for none in a column.

    Raises InputError where lengths do not fit, a type is unknown or a place is not finite.
    """

    xyz: Array
    type: NDArray[np.str_]
    columns: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    order: Array | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "xyz", without_masked(self.xyz).astype(np.float64))
        object.__setattr__(self, "type", np.asarray(self.type, dtype=str))
        columns, said = known_values({name: without_masked(values) for name, values in self.columns.items()})
        object.__setattr__(self, "columns", columns)
        object.__setattr__(self, "notes", tuple(dict.fromkeys((*self.notes, *said))))
        if self.xyz.ndim != 2:
            raise InputError(f"points: xyz has shape {self.xyz.shape}: must be (n, 2) or (n, 3)")
        given = self.xyz if self.order is None else self.order
        for name, values in {"type": self.type, "order": given, **self.columns}.items():
            if values.shape[:1] != (len(self),):
                raise InputError(
                    f"points: column '{name}' has shape {values.shape}: there are {len(self)} points"
                )
        for kind in set(self.type.tolist()) - set(POINT_TYPES):
            raise InputError(
                f"points: '{kind}' is not a type of point" + did_you_mean(str(kind), list(POINT_TYPES))
            )
        if not (finite := np.isfinite(self.xyz).all(axis=-1)).all():
            row = int(np.argmin(finite))
            raise InputError(f"points: point {row} is not finite: {self.xyz[row]}")

    def __len__(self) -> int:
        return len(self.xyz)

    def __repr__(self) -> str:
        kinds = ", ".join(f"{(self.type == kind).sum()} {kind}" for kind in POINT_TYPES if kind in self.type)
        columns = f"; columns {', '.join(self.columns)}" if self.columns else ""
        return f"Points({kinds or 'none'}{columns})"

    def select(self, rows: NDArray[Any]) -> Points:
        """The rows named by an index or mask."""
        columns = {k: v[rows] for k, v in self.columns.items()}
        return Points(self.xyz[rows], self.type[rows], columns, self.taken[rows], self.notes)

    def of(self, *types: str) -> Points:
        """The points of the given types, in file order."""
        return self.select(np.isin(self.type, types))

    @cached_property
    def taken(self) -> Array:
        """When each point (n,) was taken: its place in the order of all of them."""
        return order_of(self.columns, self.type) if self.order is None else self.order

    @cached_property
    def typical_sigma(self) -> float | None:
        """Median of the column `sigma` over the points that are fitted anyway; None without."""
        sigma = self.numbers("sigma")
        told = sigma[np.isin(self.type, FITTED_TYPES) & np.isfinite(sigma)]
        return float(np.median(told)) if len(told) else None

    def relative_noise(self, typical: float | None = None) -> Array:
        """Noise (n,) of each point by the column `sigma`, over the typical one (of these points if not
        given), at least `BEST`; 1 without.

        Raises InputError where one is not above 0.
        """
        sigma = self.numbers("sigma")
        wrong = np.flatnonzero(sigma <= 0.0)
        if len(wrong):
            raise InputError(
                f"points: sigma is a noise level and must be above 0, but point {wrong[0]} has "
                f"{sigma[wrong[0]]:g}"
            )
        typical = self.typical_sigma if typical is None else typical
        return (
            np.ones(len(self))
            if typical is None
            else np.where(np.isfinite(sigma), np.maximum(sigma / typical, BEST), 1.0)
        )

    def numbers(self, column: str) -> Array:
        """A column as numbers (n,), NaN where it is missing."""
        return np.asarray(self.columns.get(column, np.full(len(self), np.nan)), dtype=np.float64)


def no_points(dimension: int) -> Points:
    """Points of a case before the first is taken."""
    return Points(np.zeros((0, dimension)), np.zeros(0, dtype=str))


@dataclass(frozen=True, eq=False)
class Truth:
    """The truth is what only evaluation may see: surface, held-out points (n, d), their `unseen` mask,
    correspondence (prior, truth), outlier rows.
    """

    surface: Surface | None = None
    held_out: Array | None = field(default=None, repr=False)
    unseen: NDArray[np.bool_] | None = field(default=None, repr=False)
    correspondence: tuple[Array, Array] | None = field(default=None, repr=False)
    outliers: NDArray[np.int64] | None = field(default=None, repr=False)


@dataclass(frozen=True, eq=False)
class Case:
    """A case holds a prior surface (prior frame), measured points (map frame) and landmarks, with lengths in
    `units`, and never changes.

    Raises InputError for parts that do not fit together, and for what no file may hold either.
    """

    name: str
    prior: Surface
    points: Points
    prior_landmarks: Mapping[str, Array] = field(default_factory=dict)
    init: Array | None = None
    units: str = "mm"
    frame: str = "unknown"  # of the points
    prior_frame: str = "unknown"
    prior_file_units: str | None = None  # what is exported on the prior is in them again; None: `units`
    image: Mapping[str, str] = field(default_factory=dict)  # of a grey image of the prior: path, sha256
    # one of PRIOR_OF: only a template's parts may be removed because the map lacks points on them
    prior_of: str = "patient"
    notes: str = ""
    files: Mapping[str, str] = field(default_factory=dict)  # file name -> sha256
    columns: Mapping[str, str] = field(default_factory=dict)  # what became of each heading of the table
    truth: Truth | None = None
    # further surfaces of the same patient in the prior's frame, in order of time
    phases: tuple[Surface, ...] = ()

    def __post_init__(self) -> None:
        for what, kind in (("prior", Surface), ("points", Points)):
            if not isinstance(thing := getattr(self, what), kind):
                raise InputError(
                    f"case {self.name}: {what} of type {type(thing).__name__}: must be {kind.__name__}; "
                    "o3dls.case_of takes meshes, clouds and images of other libraries"
                )
        if self.points.xyz.shape[1:] != (self.dimension,):
            raise InputError(
                f"case {self.name}: points are {self.points.xyz.shape[1]}D, the prior is {self.dimension}D"
            )
        for name, values in self.points.columns.items():
            check_possible(name, values, f"case {self.name}", "point {}".format)
        if self.units not in UNITS:
            raise InputError(
                f"case {self.name}: units = '{self.units}': lengths of a case are in "
                f"{' or '.join(UNITS)}; scale them first"
            )
        lengths = ("px",) if self.units == "px" else tuple(unit for unit in MILLIMETRES if unit != "px")
        if self.prior_file_units not in (None, *lengths):
            raise InputError(
                f"case {self.name}: prior_file_units = '{self.prior_file_units}': must be one of "
                f"{', '.join(lengths)}"
            )
        for key, frame in (("frame", self.frame), ("prior_frame", self.prior_frame)):
            if frame not in SPACES:
                raise InputError(f"case {self.name}: {key} = '{frame}': must be one of {', '.join(SPACES)}")
        if self.prior_of not in PRIOR_OF:
            raise InputError(
                f"case {self.name}: prior_of = '{self.prior_of}': must be one of {', '.join(PRIOR_OF)}"
            )
        if self.init is not None and not is_pose(self.init, self.dimension):
            raise InputError(
                f"case {self.name}: init is not a pose: it must be a rotation, a shift and one scale"
            )
        for name, at in self.prior_landmarks.items():
            if np.shape(at) != (self.dimension,) or not np.isfinite(at).all():
                raise InputError(
                    f"case {self.name}: landmark '{name}' of the prior is {at}: must be {self.dimension} "
                    "finite numbers"
                )
        if (self.points.type == "landmark").any() and "name" not in self.points.columns:
            raise InputError(f"case {self.name}: points of type landmark need a column 'name'")
        object.__setattr__(self, "prior", self.prior.without_unused())
        object.__setattr__(self, "phases", tuple(phase.without_unused() for phase in self.phases))
        if self.prior.watertight and self.prior.volume < 0.0:
            raise InputError(
                f"case {self.name}: the prior's faces are wound inwards: reverse the order of their corners"
            )
        stale = {*(f"{name}_{self.units}" for name in OF_A_RUN), *WITHOUT_UNIT} & self.prior.fields.keys()
        if stale:  # the surface of an earlier run, which this one must not take for its own
            fields = {name: values for name, values in self.prior.fields.items() if name not in stale}
            object.__setattr__(self, "prior", replace(self.prior, fields=fields))

    def __repr__(self) -> str:
        marks = f", {len(self.prior_landmarks)} landmarks of the prior" if self.prior_landmarks else ""
        held = f"{self.name!r}: {self.prior!r}, {self.points!r}{marks}"
        return f"Case({held}; {self.units}, frame {self.frame})"

    @property
    def dimension(self) -> int:
        return self.prior.dimension

    def landmark_partners(self) -> dict[int, str]:
        """Row of each landmark among the points that has a partner on the prior -> the partner's name, in the
        points' order. Names need not be equal: `registration/landmark_names.py` says which mean one place.
        """
        rows = np.flatnonzero(self.points.type == "landmark").tolist()
        named = self.points.columns.get("name", np.full(len(self.points), ""))
        prior = list(self.prior_landmarks)
        return {rows[i]: prior[j] for i, j in partners([str(named[k]) for k in rows], prior).items()}

    def landmark_doubts(self) -> list[str]:
        """Sentences on names of landmarks that may mean either of two places, and so have no partner."""
        names = [str(name) for name in self.points.of("landmark").columns.get("name", ())]
        prior = list(self.prior_landmarks)
        found = (("points", doubts(names, prior)), ("prior", doubts(prior, names)))
        return [f"landmarks of the {side}: {said}" for side, said in found if said]

    def landmark_pairs(self) -> tuple[list[str], Array, Array]:
        """Names among the points and positions (prior frame, map frame) of the landmarks that both sides
        have, in the points' order.
        """
        pairs = self.landmark_partners()
        names = [str(self.points.columns["name"][k]) for k in pairs]
        prior = np.array([self.prior_landmarks[name] for name in pairs.values()])
        return names, prior.reshape(-1, self.dimension), self.points.xyz[list(pairs)]

    def visible(self, types: tuple[str, ...] = FITTED_TYPES) -> Case:
        """What a stage may see: points of the given types and the landmarks; no truth, no held-out data."""
        return replace(self, points=self.points.of(*types, "landmark"), truth=None, files={})
