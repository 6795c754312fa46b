"""Pipelines from TOML: the same objects as from Python, and every mistake named with its file and key."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path
from typing import Any

from ..errors import InputError, O3dlsError, PipelineError, did_you_mean
from ..io.atomic import check_free
from ..io.case_reader import read_case
from ..io.documents import LARGEST_TOML, parse_toml, parse_value
from ..io.text import decode, read_bytes
from ..plugins.plugin import GROUPS, Plugin, load
from ..resources import pipeline_file
from .mistakes import order_mistakes
from .pipeline import Pipeline
from .start import say_unpaired

TOP = {"case": str, "out": str, "folds": int, "keep_last": bool, "stage": list, "write": list}
FOLDERS = ("case", "out")
LISTS = "a list of tables: [[stage]], [[write]]"
KINDS = {str: "a text", int: "a whole number", bool: "true or false", list: LISTS}

Tables = dict[str, Any]


def read_pipeline(path: str | Path, settings: Iterable[str] = ()) -> Pipeline:
    """Read the pipeline of a TOML file, its folders taken from where the file stands.

    Parameters
    ----------
    path : str or Path
        the pipeline file, as docs/pipeline_file.md describes it.
    settings : iterable of str, default none
        texts STAGE.PARAM=VALUE that override the file.

    Returns
    -------
    Pipeline
        the same as one made in Python.

    Raises
    ------
    PipelineError
        with every mistake, each with its place.
    InputError
        where the file cannot be read.

    Examples
    --------
    >>> import o3dls
    >>> o3dls.read_pipeline("pipeline.toml", ["icp.keep=0.9"]).names
    ['start', 'landmarks', 'icp']
    """
    path, settings = Path(path), list(settings)
    text = decode(read_bytes(path, LARGEST_TOML), path)
    try:
        tables = _resolve_files(parse_toml(text, str(path)), path.parent)
    except InputError as error:
        raise PipelineError(str(error)) from None
    changed = overridden(deepcopy(tables), settings)
    try:
        return pipeline_from(changed, path.parent)
    except PipelineError as error:
        own = _list_mistakes(tables, path.parent)
        raise PipelineError(
            *(f"{path}: {said}" if said in own else _blame_settings(said, settings) for said in error.args)
        ) from None


def _list_mistakes(tables: Tables, folder: Path) -> tuple[str, ...]:
    """Return the mistakes of a file as it stands, without the settings that overrode it."""
    try:
        pipeline_from(tables, folder)
    except PipelineError as error:
        return error.args
    return ()


def _blame_settings(mistake: str, settings: list[str]) -> str:
    """Return a mistake that the file alone does not have, behind the settings that it comes from."""
    meant = [setting for setting in settings if setting.partition("=")[0].strip() in mistake] or settings
    return f"{' '.join(f'--set {setting}' for setting in meant)}: {mistake}"


def _resolve_files(tables: Tables, folder: Path) -> Tables:
    """Return the tables with the files that writers name (`grid`, `image`) taken from a folder, as case and
    out are.
    """
    for table in tables.get("write", []) if isinstance(tables.get("write"), list) else []:
        for key in ("grid", "image") if isinstance(table, dict) else ():
            if isinstance(table.get(key), str):
                table[key] = str(folder / table[key])
    return tables


def all_mistakes(path: str | Path, case: str | Path | None = None) -> list[str]:
    """Return every mistake of a pipeline file and of its case, or of the case named here, one sentence each.

    Nothing is run or written. An earlier run in the folder `out` is none.
    """
    mistakes: list[str] = []
    pipeline: Pipeline | None = None
    try:
        pipeline = read_pipeline(path)
    except O3dlsError as error:
        mistakes += map(str, error.args)
    folder = case or (None if pipeline is None else pipeline.case)
    if pipeline is not None and pipeline.out:
        with _note_mistakes(mistakes):
            check_free(pipeline.out, True, "run", [Path(source) for source in (path, folder) if source])
    if folder:
        from ..parallel import compiling_said  # imported late: who only checks a file needs no numba

        with _note_mistakes(mistakes), compiling_said():
            subject = read_case(folder)
            mistakes += [] if pipeline is None else pipeline.refusals(subject)
            if not mistakes:
                say_unpaired(subject)
    return mistakes


@contextmanager
def _note_mistakes(mistakes: list[str]) -> Iterator[None]:
    """Add the mistakes of the block as sentences, and go on."""
    try:
        yield
    except O3dlsError as error:
        mistakes += map(str, error.args)


def default_pipeline(settings: Iterable[str] = ()) -> Pipeline:
    """Return the packaged default: landmarks, icp, deform, topology, level_set, report, export.

    Parameters
    ----------
    settings : iterable of str, default none
        texts STAGE.PARAM=VALUE that override it.

    Returns
    -------
    Pipeline

    Raises
    ------
    PipelineError
        with every mistake of the settings.

    Examples
    --------
    >>> import o3dls
    >>> o3dls.default_pipeline(["folds=3"]).folds
    3
    """
    return read_pipeline(pipeline_file("default"), settings)


def pipeline_from(tables: Tables, folder: Path = Path()) -> Pipeline:
    """Return a pipeline from the tables of a file, or from the `pipeline` of run.json.

    Raises PipelineError with every mistake.
    """
    mistakes = [f"{key}: no such key{did_you_mean(key, list(TOP))}" for key in tables if key not in TOP]
    mistakes += [
        f"{k} = {v!r}: must be {KINDS[TOP[k]]}"
        for k, v in tables.items()
        if k in TOP and type(v) is not TOP[k]
    ]
    if mistakes:
        raise PipelineError(*mistakes)
    stages, writes = (_make_plugins(kind, tables.get(kind, []), mistakes) for kind in ("stage", "write"))
    if mistakes:
        steps = [_step_of_table(table) for table in tables.get("stage", []) if isinstance(table, Mapping)]
        raise PipelineError(*mistakes, *order_mistakes(steps))
    others = {key: value for key, value in tables.items() if key not in GROUPS}
    return Pipeline(
        stages, writes, **{key: folder / of if key in FOLDERS else of for key, of in others.items()}
    )


def overridden(tables: Tables, settings: Iterable[str]) -> Tables:
    """Return the tables with settings `STAGE.PARAM=VALUE` put in, STAGE being the name of an estimate or a
    writer.

    Raises PipelineError.
    """
    for setting in settings:
        key, equals, value = setting.partition("=")
        *owners, name = key.strip().split(".")
        if not equals or not name or "" in owners:
            raise PipelineError(f"--set {setting}: must be STAGE.PARAM=VALUE, such as icp.keep=0.9")
        if key.strip() in FOLDERS:
            raise PipelineError(
                f"--set {setting}: names a folder, not a parameter: use --{name} {shlex.quote(value.strip())}"
            )
        target = _find_table(tables, owners[0], setting) if owners else tables
        for part in owners[1:]:  # such as `phases.deform.odds`
            target = target.setdefault(part, {})
            if not isinstance(target, dict):
                raise PipelineError(f"--set {setting}: '{part}' is not a table")
        target[name] = parse_value(value.strip())
    return tables


def _make_plugins(kind: str, tables: list[Any], mistakes: list[str]) -> list[Any]:
    """Make the stages or writers of a file; their mistakes are added to `mistakes`, each with the place of
    its table.
    """
    made = []
    for k, table in enumerate(tables, 1):
        try:
            made.append(_make_plugin(kind, table))
        except PipelineError as error:
            mistakes += [f"[[{kind}]] {k}: {mistake}" for mistake in error.args]
    return made


def _make_plugin(kind: str, table: Any) -> Plugin:
    if not isinstance(table, Mapping):
        raise PipelineError(f"must be a table, not {table!r}")
    if "use" not in table:
        raise PipelineError(
            f'use: is missing; name the {kind}, such as use = "{"icp" if kind == "stage" else "report"}"'
        )
    if not isinstance(table["use"], str):
        raise PipelineError(f"use = {table['use']!r}: must be the name of one {kind}")
    plugin = load(kind, table["use"])
    mistakes = [
        f"{plugin.name}.{k}: no such parameter: did you mean '{f.alias}'?"
        for k, f in plugin.model_fields.items()
        if f.alias and k in table
    ]
    if mistakes:  # these names are for Python only
        raise PipelineError(*mistakes)
    return plugin.model_validate({key: value for key, value in table.items() if key != "use"})


def _step_of_table(table: Mapping[str, Any]) -> tuple[str, str, str | None]:
    use = str(table.get("use"))
    after = table.get("after")
    return use, str(table.get("as") or use), after if isinstance(after, str) else None


def _find_table(tables: Tables, owner: str, setting: str) -> Tables:
    every = [
        table for kind in ("stage", "write") for table in tables.get(kind, []) if isinstance(table, dict)
    ]
    names = [str(table.get("as") or table.get("use")) for table in every]
    if owner not in names:
        raise PipelineError(f"--set {setting}: the pipeline has no '{owner}'{did_you_mean(owner, names)}")
    if names.count(owner) > 1:
        raise PipelineError(
            f"--set {setting}: the pipeline has {names.count(owner)} named '{owner}'; set it in the "
            "pipeline file"
        )
    return every[names.index(owner)]
