"""How it was made: everything a reader needs to check the run or to make it again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from .markup import Child, Html, join, table, tag
from .section import Section
from .subject import Subject


def made_section(subject: Subject) -> Section:
    """Per run: status of each estimate, the pipeline with every default, versions, seeds, file hashes."""
    parts = [_run(record, subject.folders[k].name if len(subject.records) > 1 else None) for k, record in enumerate(subject.records)]
    return Section("made", "How it was made", join(*parts))


def _run(record: Mapping[str, Any], name: str | None) -> Html:
    rows: list[list[Child]] = [
        [key, e["status"], "yes" if e["converged"] else "no", e["iterations"], f"{e['seconds']:.2f}", f"{e['scale']:.4f}"]
        for key, e in record["estimates"].items()
    ]
    facts = {key: record[key] for key in ("versions", "seeds", "threads")} | {"files (sha256)": record["case"]["files"]}
    return join(
        tag("h3", name) if name else None,
        tag("div", table(["estimate", "status", "converged", "iterations", "seconds", "scale"], rows), class_="left"),
        tag("details", tag("summary", "The pipeline, every default written out"), tag("pre", tag("code", _pretty(record["pipeline"])))),
        tag("details", tag("summary", "Versions, seeds, threads, input files"), tag("pre", tag("code", _pretty(facts)))),
    )


def _pretty(value: Any) -> str:
    return json.dumps(value, indent=2, ensure_ascii=False)
