"""What Python's `help` shows of a plugin: its author's words, parameters and methods, none of pydantic's."""

from __future__ import annotations

import inspect
from textwrap import fill
from typing import TYPE_CHECKING, dataclass_transform, get_args

from pydantic import BaseModel, Field
from pydantic.fields import FieldInfo

from .parameters import Parameter, described, part

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)

INDENT = " " * 4


@dataclass_transform(
    kw_only_default=True, field_specifiers=(Field,)
)  # repeated here, as type checkers do not look at the parent
class PluginType(ModelMetaclass):
    # The class of plugin classes. `help` and editors ask it what a class lists, says of itself and takes.
    model_fields: dict[str, FieldInfo]  # set by pydantic

    def __dir__(cls) -> list[str]:
        own = [vars(kind) for kind in cls.__mro__ if kind not in BaseModel.__mro__]
        names = {name for members in own for name in members if not name.startswith("_")}
        return sorted(names - {"model_config"} | {"__call__"})

    @property
    def __doc__(cls) -> str:  # type: ignore[override]
        """The words of a plugin, and behind them a block per parameter where it can be used by name."""
        fields = cls.model_fields if hasattr(cls, "name") else {}
        blocks = [_format_block(name, field) for name, field in fields.items()]
        return "\n".join([words(cls), *(["", "Parameters", "----------"] if blocks else []), *blocks])

    @property
    def __signature__(cls) -> inspect.Signature:
        """The parameters with their types alone: bounds are told in the block of each."""
        return inspect.Signature([_as_argument(name, field) for name, field in cls.model_fields.items()])

    @__signature__.setter
    def __signature__(cls, full: object) -> None:
        """Pydantic's own, which has the bounds in it, is not kept."""


def words(plugin: type) -> str:
    """Return the docstring of a plugin as its author wrote it, or that of its parent where it has none."""
    said = (vars(kind).get("__doc__") for kind in plugin.__mro__)
    return inspect.cleandoc(next(filter(None, said), ""))


def _format_block(name: str, field: FieldInfo) -> str:
    """Return what a parameter takes, with its default, and below its meaning, with the accepted words."""
    p = described(name, field)
    bounded = p.limits.startswith(("[", "("))
    value = f"{type(p.default).__name__}()" if part(field) else repr(p.default)
    default = "" if field.is_required() else f", default {value}"
    meaning = f"{p.meaning} ({p.limits})" if p.limits and not bounded else p.meaning
    below = fill(meaning, 100, initial_indent=INDENT, subsequent_indent=INDENT)
    return f"{name} : {_describe_type(field, p, bounded=bounded)}{default}\n{below}"


def _describe_type(field: FieldInfo, p: Parameter, *, bounded: bool) -> str:
    """Return the type of a parameter with its bounds and unit."""
    kind = part(field)
    within = f" within {p.limits}" if bounded else "," * bool(p.unit)
    nothing = " or None" if type(None) in get_args(field.annotation) else ""
    return f"{kind.__name__ if kind else p.kind}{within} {p.unit}".rstrip() + nothing


def _as_argument(name: str, field: FieldInfo) -> inspect.Parameter:
    default = inspect.Parameter.empty if field.is_required() else described(name, field).default
    keyword = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, keyword, default=default, annotation=field.annotation)
