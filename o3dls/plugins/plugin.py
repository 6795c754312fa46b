"""Plugins: typed parameters that check themselves, found by entry point."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from ..case import Case
from ..errors import PipelineError, did_you_mean
from .help import PluginType
from .parameters import as_written, mistakes, part

# entry points of each kind of table in a pipeline file
GROUPS = {
    "stage": "o3dls.stages",
    "write": "o3dls.writers",
}


class Plugin(BaseModel, ABC, metaclass=PluginType):
    """A plugin has typed, frozen parameters that check themselves; help, pipeline syntax and records come
    from them.

    A plugin may be a parameter of another one, its part: a table in the pipeline file. `placing` names the
    parameters that a plugin does not have there.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True, allow_inf_nan=False)
    name: ClassVar[str]
    placing: ClassVar[frozenset[str]] = frozenset()

    def __init__(self, **parameters: Any) -> None:
        """Say what is wrong in our words; a validator would not do, since those of subclasses run outside of
        it.
        """
        try:
            super().__init__(**parameters)
        except ValidationError as error:
            raise PipelineError(*mistakes(type(self), error)) from None

    @field_validator("*", mode="before")
    @classmethod
    def _check_as_written(cls, value: Any, info: ValidationInfo) -> Any:
        """Text is neither a number nor yes or no, and a number is not yes or no: pydantic would read "no" as
        false and "1" as 1.
        """
        if info.field_name and not as_written(value, cls.model_fields[info.field_name]):
            raise PydanticCustomError("as_written", "must be of the type as written")
        return value

    @field_validator("*", mode="before")
    @classmethod
    def _make_part(cls, value: Any, info: ValidationInfo) -> Any:
        """Make the part that a table describes, with its mistakes under the name of the part."""
        field = cls.model_fields[info.field_name] if info.field_name else None
        kind = part(field) if field else None
        if kind is None or not issubclass(kind, Plugin) or not isinstance(value, Mapping | kind):
            return value
        try:
            made = kind(**value) if isinstance(value, Mapping) else value
        except PipelineError as error:
            raise PydanticCustomError("part", "a part has mistakes", {"mistakes": error.args}) from None
        if given := sorted(kind.placing & made.model_fields_set):
            wrong = [
                f"{kind.name}.{kind.model_fields[name].alias or name}: no such parameter" for name in given
            ]
            raise PydanticCustomError("part", "a part has mistakes", {"mistakes": wrong})
        return made

    def record(self) -> dict[str, Any]:
        """Return every parameter with its value, as a pipeline file would say it."""
        parts = {name: part(field) for name, field in type(self).model_fields.items()}
        left_out = {
            name: set(kind.placing) for name, kind in parts.items() if kind and issubclass(kind, Plugin)
        }
        return {"use": self.name} | self.model_dump(mode="json", by_alias=True, exclude=left_out or None)

    def obstacle(self, case: Case) -> str | None:
        """Return why this plugin cannot work on the case (a sentence), None where it can."""
        return None

    def mistake(self, case: Case) -> str | None:
        """Return what of the case or the parameters must be corrected first (a sentence), None where nothing
        must; it is asked where there is no obstacle.
        """
        return None


@cache
def registered(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of `o3dls.stages` or `o3dls.writers` by name. Raises PipelineError where two
    share a name.
    """
    found: dict[str, EntryPoint] = {}
    for entry in entry_points(group=group):
        if entry.name in found and found[entry.name].value != entry.value:
            raise PipelineError(
                f"two plugins are named '{entry.name}' in {group}: {found[entry.name].value} and "
                f"{entry.value}"
            )
        found[entry.name] = entry
    return found


def load(kind: str, name: Any) -> type[Plugin]:
    """Load the class of a stage (kind 'stage') or writer (kind 'write') by name. Raises PipelineError where
    there is none or it cannot load.
    """
    known = registered(GROUPS[kind])
    if name not in known:
        raise PipelineError(f"no {kind} '{name}'" + did_you_mean(str(name), list(known)))
    try:
        plugin: type[Plugin] = known[name].load()
    except (ImportError, AttributeError) as error:
        raise PipelineError(f"{kind} '{name}' cannot be loaded from {known[name].value}: {error}") from error
    return plugin
