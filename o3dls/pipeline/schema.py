"""The JSON schema of a pipeline file, by which editors complete and check it; made from the parameters."""

from __future__ import annotations

from typing import Any

from ..plugins.help import words
from ..plugins.parameters import part
from ..plugins.plugin import GROUPS, Plugin, load, registered
from .mistakes import MOST_FOLDS
from .pipeline import Pipeline

DRAFT = "http://json-schema.org/draft-07/schema#"  # the newest that editors of TOML know
MEANINGS = {
    "case": "case folder, from where this file stands",
    "out": "run folder to make, from where this file stands",
    "stage": "stages in their order",
    "write": "writers of what the run leaves behind",
}
KEEP_LAST = {
    "description": "end with the last estimate also where left-out points clearly prefer an earlier one",
    "type": "boolean",
    "default": Pipeline.keep_last,
}

Schema = dict[str, Any]


def schema() -> Schema:
    """Return what a pipeline file may say, stages and writers of other installed packages included.

    It knows each parameter by itself; what must fit together, `o3dls check` says.
    """
    folders: Schema = {key: {"type": "string"} for key in ("case", "out")}
    tables: Schema = {kind: {"type": "array", "items": {"oneOf": _kind_schemas(kind)}} for kind in GROUPS}
    known = {**folders, **tables}
    properties = {key: {**of, "description": MEANINGS[key]} for key, of in known.items()}
    return {
        "$schema": DRAFT,
        "title": "o3dls pipeline",
        "type": "object",
        "additionalProperties": False,
        "properties": {**properties, "folds": _folds_schema(), "keep_last": KEEP_LAST},
    }


def _folds_schema() -> Schema:
    return {
        "description": "folds of the cross-validation; 0: none",
        "type": "integer",
        "oneOf": [{"const": 0}, {"minimum": 2, "maximum": MOST_FOLDS}],
        "default": Pipeline.folds,
    }


def _kind_schemas(kind: str) -> list[Schema]:
    return [_named_schema(name, load(kind, name)) for name in sorted(registered(GROUPS[kind]))]


def _named_schema(name: str, plugin: type[Plugin]) -> Schema:
    """Return the table of a stage or writer in the file, with its name."""
    table = _plugin_schema(plugin)
    use = {"const": name, "description": table["description"]}
    return {
        **table,
        "title": name,
        "properties": {"use": use, **table["properties"]},
        "required": ["use", *table.get("required", [])],
    }


def _plugin_schema(plugin: type[Plugin]) -> Schema:
    """Return the parameters of a stage or writer; those of a part, which is placed with it, as a table
    within.
    """
    found = plugin.model_json_schema()
    found.pop("$defs", None)  # definitions of the parts, which are inserted below
    properties = found["properties"]
    for name, field in plugin.model_fields.items():
        key = field.alias or name
        inner = part(field)
        if inner and issubclass(inner, Plugin):
            properties[key] = _part_schema(inner)
        else:
            properties[key] = _parameter_schema(properties[key])
    found["description"] = " ".join(words(plugin).split())
    return found


def _part_schema(plugin: type[Plugin]) -> Schema:
    table = _plugin_schema(plugin)
    hidden = {plugin.model_fields[name].alias or name for name in plugin.placing}
    table["properties"] = {key: of for key, of in table["properties"].items() if key not in hidden}
    return table


def _parameter_schema(found: Schema) -> Schema:
    """Return a parameter with its unit in words, and without the null that TOML does not have."""
    unit = found.pop("unit", "1")
    found.pop("title", None)
    if unit != "1":
        found["description"] = f"{found['description']} ({unit})"
    if found.get("default", 0) is None:
        del found["default"]
    others = [of for of in found.pop("anyOf", []) if of != {"type": "null"}]
    return {**others[0], **found} if len(others) == 1 else {**found, **({"anyOf": others} if others else {})}
