"""run.json as classes that write, read and check it: one that was damaged is refused with the place in it."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

from ..errors import InputError

SCHEMA = "o3dls/run/2"
NAME = r"^[A-Za-z][A-Za-z0-9_-]*$"  # the name of an estimate is also that of a folder
UNFINISHED = "so it is not a finished run; run it again"
Amount = float | None  # null stands for a number that was not finite
WANTED = {  # by the type of pydantic's error
    **dict.fromkeys(("dict_type", "model_type", "model_attributes_type"), "a table"),
    "list_type": "a list",
    "string_type": "a text",
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
}


class _Part(BaseModel):
    """A part is a table of the record: values must be of the kind as written, further keys are let be, and
    fields keep the order of the file. Its checks are built when a record is first read or written, since most
    commands do neither.
    """

    model_config = ConfigDict(strict=True, extra="allow", frozen=True, allow_inf_nan=False, defer_build=True)

    def table(self) -> dict[str, Any]:
        """Return the table as the file has it."""
        return self.model_dump(by_alias=True, exclude_unset=True)


def _read_as(part: type[_Part]) -> AfterValidator:
    """Return a validator of a table that must be readable as a part, and stays as it is, in the order of its
    maker.
    """

    def read(table: dict[str, Any]) -> dict[str, Any]:
        part.model_validate(table)
        return table

    return AfterValidator(read)


class _Step(_Part):
    use: str
    as_: str | None = Field(None, alias="as")


class _Pipeline(_Part):
    stage: list[_Step]
    write: list[_Step] = []


class _Direction(_Part):
    meaning: str
    sd: Amount
    shift: list[float]
    turn_degrees: list[float]
    log_scale: float


class _Facts(_Part):
    """These are the facts of the stages that other parts of o3dls read."""

    changes: list[str] = []
    observability: list[_Direction] | None = None
    landmarks: dict[str, dict[str, Amount]] = {}


class _Scores(_Part):
    """Scores are given by set of points, with the measures that each set has; the truth alone has other
    measures than distances.
    """

    __pydantic_extra__: dict[str, dict[str, Amount]] = Field(init=False)


class _Validity(_Part):
    watertight: bool
    components: int | None
    euler: int | None
    self_intersections: int | None
    flipped_faces: int | None
    volume_change: Amount
    __pydantic_extra__: dict[str, Amount] = Field(init=False)


class CaseRecord(_Part):
    """The record of a case has the number of its points by type and the hashes of its files."""

    name: str
    units: Literal["mm", "px"]
    frame: Literal["LPS", "RAS", "unknown"]
    dimension: Literal[2, 3]
    prior_of: str = "patient"
    points: dict[str, int] = {}
    columns: dict[str, str] = {}
    image: dict[str, str] = {}
    files: dict[str, str]


class WarningRecord(_Part):
    """This records a `RunWarning`; its code may be one of a later version."""

    code: str
    stage: str
    sentence: str


class EstimateRecord(_Part):
    """This records an estimate with its scores by set and its validity; the unit of its sigma is the
    case's.
    """

    status: str
    converged: bool
    seconds: float = Field(ge=0.0)
    iterations: int = Field(ge=0)
    T_map_prior: list[list[float]]
    scale: float
    sigma_mm: Amount = None
    sigma_px: Amount = None
    warnings: list[WarningRecord]
    facts: Annotated[dict[str, Any], _read_as(_Facts)]
    scores: Annotated[dict[str, dict[str, Any]], _read_as(_Scores)]
    validity: Annotated[dict[str, Any], _read_as(_Validity)]


class Provenance(_Part):
    """The provenance is everything that it takes to make the run again; the pipeline is as its file would say
    it, with every default.
    """

    schema_: str = Field(alias="schema")
    case: CaseRecord
    pipeline: Annotated[dict[str, Any], _read_as(_Pipeline)]
    versions: dict[str, str | None]
    seeds: dict[str, Any]
    threads: dict[str, Any]
    seconds: float = Field(ge=0.0)

    @property
    def parameters(self) -> dict[str, Any]:
        """Every parameter of every stage in order, as `estimate.parameter`."""
        return {
            f"{one.get('as') or one['use']}.{key}": one[key] for one in self.pipeline["stage"] for key in one
        }


class RunRecord(Provenance):
    """This is the whole content of run.json."""

    final: str
    valid: bool
    faults: list[str]
    estimates: dict[str, EstimateRecord]

    @model_validator(mode="after")
    def _check_consistent(self) -> RunRecord:
        if "start" not in self.estimates:
            raise ValueError(f"estimates: has no 'start', {UNFINISHED}")
        if self.final not in self.estimates:
            raise ValueError(f"final: '{self.final}' is no estimate of the run: must be one of its estimates")
        for name, one in self.estimates.items():
            self._check_estimate(f"estimates.{name}", name, one)
        return self

    def _check_estimate(self, where: str, name: str, one: EstimateRecord) -> None:
        """Raise ValueError for what depends on the case: its unit is a part of keys, and its dimension the
        size of a pose.
        """
        if not re.fullmatch(NAME, name):
            raise ValueError(f"{where}: the name of an estimate must be letters, digits, _ and -")
        size, unit = self.case.dimension + 1, self.case.units
        if [len(row) for row in one.T_map_prior] != [size] * size:
            raise ValueError(f"{where}.T_map_prior: must be {size} rows of {size} numbers")
        if f"sigma_{unit}" not in one.model_fields_set:
            raise ValueError(f"has no '{where}.sigma_{unit}', {UNFINISHED}")
        for group, scores in one.scores.items():
            if group != "truth" and scores.get(f"mean_{unit}") is None:
                raise ValueError(f"{where}.scores.{group}: has no number 'mean_{unit}'")

    def text(self) -> str:
        """Return the content of the file."""
        return json.dumps(self.table(), indent=1, allow_nan=False) + "\n"


def checked(found: Any, path: str) -> RunRecord:
    """Return the record with this content. Raises InputError with the place in the file of the first mistake,
    and what it must be.
    """
    schema = found.get("schema") if isinstance(found, dict) else None
    if schema != SCHEMA:
        raise InputError(
            f"{path}: schema is {repr(schema) if schema else 'not there':.80}: must be '{SCHEMA}'"
        )
    try:
        return RunRecord.model_validate(found)
    except ValidationError as error:
        raise InputError(f"{path}: {_describe_error(error.errors(include_url=False)[0])}") from None


def _describe_error(detail: ErrorDetails) -> str:
    """Return a sentence such as `estimates.icp.seconds = 'x': must be a valid number`."""
    if detail["type"] == "value_error":
        return str(detail["ctx"]["error"])
    place = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in detail["loc"])[1:]
    if detail["type"] == "missing":
        return f"has no '{place}', {UNFINISHED}"
    wanted = WANTED.get(detail["type"], detail["msg"].removeprefix("Input should be "))
    return f"{place} = {json.dumps(detail['input']):.80}: must be {wanted}"


def plain(value: Any) -> Any:
    """Return the value as JSON knows it: numpy unwrapped, what is not finite as null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(item) for item in value]
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value
