"""Pipelines from TOML: the same objects as from Python, and every mistake named with its file and key."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from .errors import O3dlsError, PipelineError, did_you_mean
from .io.atomic import check_free
from .io.case_folder import read_case
from .io.text import decode, read_bytes
from .pipeline import Pipeline, order_mistakes
from .resources import pipeline_file
from .stage import Plugin, load

TOP = {"case": str, "out": str, "folds": int, "stage": list, "write": list}
KINDS = {str: "a text", int: "a whole number", list: "a list of tables: [[stage]], [[write]]"}

Tables = dict[str, Any]


def read_pipeline(path: str | Path, settings: Iterable[str] = ()) -> Pipeline:
    """The pipeline of a TOML file, its folders taken from where the file stands; `settings` such as `icp.keep=0.9` overrule it.

    Raises PipelineError with every mistake, InputError where the file cannot be read.
    """
    path = Path(path)
    try:
        tables = tomllib.loads(decode(read_bytes(path), path))
        return pipeline_from(overruled(tables, settings), path.parent)
    except tomllib.TOMLDecodeError as error:
        raise PipelineError(f"{path}: {error}") from None
    except PipelineError as error:
        raise PipelineError(*(f"{path}: {mistake}" for mistake in error.args)) from None


def all_mistakes(path: str | Path, case: str | Path | None = None) -> list[str]:
    """Every mistake of a pipeline file and of its case, or of the case named here, one sentence each; nothing is run or written."""
    said: list[str] = []
    pipeline: Pipeline | None = None
    with _noted(said):
        pipeline = read_pipeline(path)
    folder = case or (pipeline and pipeline.case)
    if pipeline and pipeline.out:
        with _noted(said):
            check_free(pipeline.out)
    if folder:
        with _noted(said):
            subject = read_case(folder)
            said += pipeline.obstacles(subject) if pipeline else []
    return said


@contextmanager
def _noted(said: list[str]) -> Iterator[None]:
    """Take the mistakes of the block as sentences, and go on."""
    try:
        yield
    except O3dlsError as error:
        said += map(str, error.args)


def default_pipeline(settings: Iterable[str] = ()) -> Pipeline:
    """The packaged default: landmarks, icp, deform, level_set, report, export."""
    return read_pipeline(pipeline_file("default"), settings)


def pipeline_from(tables: Tables, folder: Path = Path()) -> Pipeline:
    """A pipeline from the tables of a file, or from the `pipeline` of run.json. Raises PipelineError with every mistake."""
    said = [f"{key}: no such key{did_you_mean(key, list(TOP))}" for key in tables if key not in TOP]
    said += [f"{k} = {v!r}: must be {KINDS[TOP[k]]}" for k, v in tables.items() if k in TOP and type(v) is not TOP[k]]
    if said:
        raise PipelineError(*said)
    stages, writes = (_plugins(kind, tables.get(kind, []), said) for kind in ("stage", "write"))
    if said:
        raise PipelineError(*said, *order_mistakes([_step(table) for table in tables.get("stage", []) if isinstance(table, Mapping)]))
    places = {key: folder / tables[key] for key in ("case", "out") if key in tables}
    return Pipeline(stages, writes, folds=tables.get("folds", Pipeline.folds), **places)


def overruled(tables: Tables, settings: Iterable[str]) -> Tables:
    """The tables with settings `STAGE.PARAM=VALUE` put in, STAGE being the name of an estimate or a writer. Raises PipelineError."""
    for setting in settings:
        key, equals, value = setting.partition("=")
        owner, dot, name = key.strip().rpartition(".")
        if not equals or not name:
            raise PipelineError(f"--set {setting}: must be STAGE.PARAM=VALUE, such as icp.keep=0.9")
        target = _table(tables, owner, setting) if dot else tables
        target[name] = _value(value.strip())
    return tables


def _plugins(kind: str, tables: list[Any], said: list[str]) -> list[Any]:
    """Stages or writers of a file; mistakes are added to `said`, each with the place of its table."""
    made = []
    for k, table in enumerate(tables, 1):
        try:
            made.append(_plugin(kind, table))
        except PipelineError as error:
            said += [f"[[{kind}]] {k}: {mistake}" for mistake in error.args]
    return made


def _plugin(kind: str, table: Any) -> Plugin:
    if not isinstance(table, Mapping):
        raise PipelineError(f"must be a table, not {table!r}")
    if "use" not in table:
        raise PipelineError(f'use: is missing; name the {kind}, such as use = "{"icp" if kind == "stage" else "report"}"')
    return load(kind, table["use"]).model_validate({key: value for key, value in table.items() if key != "use"})


def _step(table: Mapping[str, Any]) -> tuple[str, str, str | None]:
    use = str(table.get("use"))
    return use, str(table.get("as") or use), table.get("after")


def _table(tables: Tables, owner: str, setting: str) -> Tables:
    every = [table for kind in ("stage", "write") for table in tables.get(kind, []) if isinstance(table, dict)]
    named = {str(table.get("as") or table.get("use")): table for table in every}
    if owner not in named:
        raise PipelineError(f"--set {setting}: the pipeline has no '{owner}'{did_you_mean(owner, list(named))}")
    return named[owner]


def _value(text: str) -> Any:
    """A value as TOML writes it, or a number or True and False as Python does; a bare word is a text."""
    readers = (lambda: tomllib.loads(f"value = {text}")["value"], lambda: {"True": True, "False": False}[text], lambda: float(text))
    for read in readers:
        with suppress(ValueError, KeyError):
            return read()
    return text
