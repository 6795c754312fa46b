"""What run.json must hold to be read: a record that was damaged or edited is refused with the place in it."""

from __future__ import annotations

import json
import re
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from ..errors import InputError

SCHEMA = "o3dls/run/2"
NAME = r"^[A-Za-z][A-Za-z0-9_-]*$"  # of an estimate, which names a folder too
Amount = float | None  # null: was not finite
WANTED = {  # by the type of pydantic's error
    **dict.fromkeys(("dict_type", "model_type", "model_attributes_type"), "a table"),
    "list_type": "a list",
    "string_type": "a text",
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
}


class _Part(BaseModel):
    """A table of the record: kinds are as written, and further keys are let be."""

    model_config = ConfigDict(strict=True, extra="allow", allow_inf_nan=False)


class _Case(_Part):
    name: str
    units: Literal["mm", "px"]
    frame: Literal["LPS", "RAS", "unknown"]
    dimension: Literal[2, 3]
    files: dict[str, str]


class _Step(_Part):
    use: str
    as_: str | None = Field(None, alias="as")


class _Pipeline(_Part):
    stage: list[_Step]
    write: list[_Step] = []


class _Warning(_Part):
    code: str
    stage: str
    sentence: str


class _Direction(_Part):
    meaning: str
    sd: Amount
    shift: list[float]
    turn_degrees: list[float]
    log_scale: float


class _Facts(_Part):
    """Of what stages have to say, what others read."""

    changes: list[str] = []
    observability: list[_Direction] | None = None
    landmarks: dict[str, dict[str, Amount]] = {}


class _Scores(_Part):
    """Distances of one set of points."""

    n: int = Field(ge=0)
    __pydantic_extra__: dict[str, Amount] = Field(init=False)


class _ScoreSets(_Part):
    truth: dict[str, Amount] = {}
    __pydantic_extra__: dict[str, _Scores] = Field(init=False)


class _Validity(_Part):
    watertight: bool
    components: int | None
    euler: int | None
    self_intersections: int | None
    flipped_faces: int | None
    volume_change: Amount
    __pydantic_extra__: dict[str, Amount] = Field(init=False)


class _Estimate(_Part):
    status: str
    converged: bool
    seconds: float = Field(ge=0.0)
    iterations: int = Field(ge=0)
    T_map_prior: list[list[float]]
    scale: float
    warnings: list[_Warning]
    facts: _Facts
    scores: _ScoreSets
    validity: _Validity


class _Record(_Part):
    case: _Case
    pipeline: _Pipeline
    versions: dict[str, Any]
    seeds: dict[str, Any]
    threads: dict[str, Any]
    seconds: float = Field(ge=0.0)
    final: str
    estimates: dict[str, _Estimate]

    @model_validator(mode="after")
    def _consistent(self) -> _Record:
        if "start" not in self.estimates:
            raise _mistake("estimates: has no 'start', so it is not a finished run; run it again")
        if self.final not in self.estimates:
            raise _mistake(f"final: '{self.final}' is no estimate of the run: must be one of its estimates")
        for name, one in self.estimates.items():
            self._check(f"estimates.{name}", name, one)
        return self

    def _check(self, where: str, name: str, one: _Estimate) -> None:
        """What depends on the case: its unit is a part of keys, and its dimension the size of a pose."""
        if not re.fullmatch(NAME, name):
            raise _mistake(f"{where}: the name of an estimate must be letters, digits, _ and -")
        size, unit = self.case.dimension + 1, self.case.units
        if [len(row) for row in one.T_map_prior] != [size] * size:
            raise _mistake(f"{where}.T_map_prior: must be {size} rows of {size} numbers")
        if type((one.model_extra or {}).get(f"sigma_{unit}", "")) not in (int, float, type(None)):
            raise _mistake(f"{where}.sigma_{unit}: must be there, a number or null")
        for group, scores in (one.scores.model_extra or {}).items():
            if (scores.model_extra or {}).get(f"mean_{unit}") is None:
                raise _mistake(f"{where}.scores.{group}: has no number 'mean_{unit}'")


def check_record(found: Any, path: str) -> dict[str, Any]:
    """The content of a run.json, where it is one. Raises InputError with the place in the file of the first
    mistake, and what it must be.
    """
    if not isinstance(found, dict) or found.get("schema") != SCHEMA:
        said = repr(found.get("schema")) if isinstance(found, dict) else "not there"
        raise InputError(f"{path}: schema is {said:.80}: must be '{SCHEMA}'")
    try:
        _Record.model_validate(found)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise InputError(f"{path}: {_sentence(first)}") from None
    return found


def _mistake(sentence: str) -> PydanticCustomError:
    return PydanticCustomError("record", "{sentence}", {"sentence": sentence})


def _sentence(detail: ErrorDetails) -> str:
    """Such as `estimates.icp.seconds = 'x': must be a valid number`."""
    if detail["type"] == "record":
        return detail["msg"]
    place = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in detail["loc"])[1:]
    if detail["type"] == "missing":
        return f"has no '{place}', so it is not a finished run; run it again"
    wanted = WANTED.get(detail["type"], detail["msg"].removeprefix("Input should be "))
    return f"{place} = {json.dumps(detail['input']):.80}: must be {wanted}"
