"""How it was made: everything a reader needs to check the run or to make it again."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from ...runs.run import Run
from ..markup import Child, Html, join, table, tag
from ..section import Section
from ..subject import Subject

COMMAND = "o3dls run pipeline.toml --case case --out again"


def made_section(subject: Subject) -> Section:
    """Show per run the status of each estimate, the pipeline with every default, versions, seeds, file
    hashes, and the command to repeat it.
    """
    names = [folder.name if len(subject.folders) > 1 else None for folder in subject.folders]
    parts = [
        _describe_run(run, name, k) for k, (run, name) in enumerate(zip(subject.runs, names, strict=True))
    ]
    return Section("made", "How it was made", join(*parts))


def _describe_run(run: Run, name: str | None, number: int) -> Html:
    rows: list[list[Child]] = [
        [
            key,
            e.status,
            "yes" if e.converged else "no",
            e.iterations,
            f"{e.seconds:.2f}",
            f"{e.scale:.4f}",
        ]
        for key, e in run.estimates.items()
    ]
    made = run.provenance
    facts = {"versions": made.versions, "seeds": made.seeds, "threads": made.threads}
    facts["files (sha256)"] = made.case.files
    return join(
        tag("h3", name) if name else None,
        tag(
            "div",
            table(["estimate", "status", "converged", "iterations", "seconds", "scale"], rows),
            class_="left",
        ),
        tag(
            "p", "To make it again, save the pipeline below in the run folder as pipeline.toml and run there:"
        ),
        copied(COMMAND, f"command-{number}"),
        tag(
            "details",
            tag("summary", "The pipeline, every default written out"),
            copied(as_toml(made.pipeline), f"toml-{number}"),
        ),
        tag(
            "details",
            tag("summary", "Versions, seeds, threads, input files"),
            tag("pre", tag("code", json.dumps(facts, indent=2, ensure_ascii=False))),
        ),
    )


def copied(text: str, identifier: str) -> Html:
    """Write a text in fixed width with a button that copies it."""
    button = tag("button", "Copy", type="button", data_copy=identifier)
    return tag("div", tag("pre", tag("code", text), id=identifier, tabindex="0"), button, class_="copied")


def as_toml(record: Mapping[str, Any]) -> str:
    """Write the pipeline of run.json as a pipeline file; keys that are null are left to their defaults."""
    top = [
        f"{key} = {_write_toml(value)}"
        for key, value in record.items()
        if key not in ("stage", "write") and value is not None
    ]
    return (
        "\n".join(
            [
                *top,
                *(line for kind in ("stage", "write") for line in _write_tables(kind, record.get(kind, []))),
            ]
        )
        + "\n"
    )


def _write_tables(kind: str, tables: list[Mapping[str, Any]]) -> Iterator[str]:
    for table_ in tables:
        yield f"\n[[{kind}]]"
        yield from (f"{key} = {_write_toml(value)}" for key, value in table_.items() if value is not None)


def _write_toml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{json.dumps(key)} = {_write_toml(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_write_toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False)
