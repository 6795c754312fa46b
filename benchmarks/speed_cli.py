"""Where the time of `o3dls run` on the demo case goes: a first run, whose loops are compiled, later ones, and
the parts of one; each in a process of its own, as from the shell.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from o3dls.resources import demo_case, pipeline_file

Row = dict[str, Any]
LIMITS = {  # what is asked for, on two cores that do nothing else
    "later run, no folds": (4.0, "s"),  # its report included
    "later run": (7.0, "s"),
    "first run / later run": (1.3, "x"),
    "  reading, scoring, writing": (1.0, "s"),
}
PARTS = {  # of one process: what is said of it, by its function
    "reading the case": "o3dls.io.case_reader:read_case",
    "checking it": "o3dls.pipeline.pipeline:Pipeline.refusals",
    "fit": "o3dls.pipeline.pipeline:Pipeline.fit",
    "scoring": "o3dls.runs.scoring:scored",
    "writing estimates": "o3dls.runs.estimate_files:write_estimate",
    "report: page": "o3dls.report.page:report_page",
    "verdict": "o3dls.cli.summary:summary",
}
FILES = ("reading the case", "scoring", "writing estimates")
TIMED = """
import builtins, functools, importlib, json, sys, time
parts = json.loads(sys.argv.pop(1))
seconds = dict.fromkeys(["imports", *parts], 0.0)

def timed(said, function):
    inside = False
    @functools.wraps(function)
    def call(*given, **named):
        nonlocal inside
        if inside:
            return function(*given, **named)
        inside, begin = True, time.perf_counter()
        try:
            return function(*given, **named)
        finally:
            inside = False
            seconds[said] += time.perf_counter() - begin
    return call

builtins.__import__ = timed("imports", builtins.__import__)
from o3dls.cli.main import main
for said, place in parts.items():
    module, name = place.split(":")
    owner = functools.reduce(getattr, name.split(".")[:-1], importlib.import_module(module))
    name = name.split(".")[-1]
    plain = getattr(owner, name)
    for one in [owner, *(found for key, found in list(sys.modules.items()) if key.startswith("o3dls"))]:
        if getattr(one, name, None) is plain:
            setattr(one, name, timed(said, plain))
try:
    main()
except SystemExit as end:
    assert not end.code, "the run failed"
print(json.dumps(seconds))
"""


def rows(repeat: int) -> list[Row]:
    """First and later runs with and without cross-validation, by the clock and, of all their processes, of
    the processor; and the parts of one by the clock alone.
    """
    with TemporaryDirectory(prefix="o3dls-speed-") as name:
        folder = Path(name)
        alone = folder / "no_folds.toml"
        alone.write_text(f"folds = 0\n{pipeline_file('default').read_text(encoding='utf-8')}")
        # as after an installation: modules are compiled once, whatever this shell says
        kept = {"NUMBA_CACHE_DIR": str(folder / "compiled"), "PYTHONDONTWRITEBYTECODE": ""}
        o3dls = [sys.executable, "-m", "o3dls"]
        found = [
            _row("nothing but the start", [*o3dls, "--version"], kept, repeat),
            _row("compiling (doctor --compile)", [*o3dls, "doctor", "--compile", "-q"], kept, 1),
            _row("first run after it", _run(folder, o3dls), kept, 1),
            _row("later run", _run(folder, o3dls), kept, repeat),
            _row("later run, no folds", _run(folder, o3dls, str(alone)), kept, repeat),
        ]
        ratio = {"value": found[2]["value"] / found[3]["value"], "unit": "x", "status": ""}
        return [*found, {"what": "first run / later run", **ratio}, *_parts(folder, str(alone), kept)]


def _run(folder: Path, o3dls: list[str], *pipeline: str) -> list[str]:
    out = str(folder / "run")
    return [*o3dls, "run", *pipeline, "--case", str(demo_case()), "--out", out, "--force", "-q"]


def _row(what: str, command: list[str], variables: Mapping[str, str], repeat: int) -> Row:
    clock, cpu = [], []
    for _ in range(repeat):
        begin, before = perf_counter(), _children()
        subprocess.run(command, env=os.environ | variables, check=True, capture_output=True)
        clock.append(perf_counter() - begin)
        cpu.append(_children() - before)
    return {"what": what, "value": median(clock), "cpu": median(cpu), "unit": "s", "status": ""}


def _children() -> float:
    """Seconds of the processor of the processes that this one has begun and that have ended."""
    spent = os.times()
    return spent.children_user + spent.children_system


def _parts(folder: Path, alone: str, variables: Mapping[str, str]) -> list[Row]:
    """Of a later run without folds, by the clock; imports happen in other parts too, and count in both."""
    command = [sys.executable, "-c", TIMED, json.dumps(PARTS), *_run(folder, [], alone)]
    done = subprocess.run(command, env=os.environ | variables, check=True, capture_output=True, text=True)
    seconds = json.loads(done.stdout.splitlines()[-1])
    seconds["reading, scoring, writing"] = sum(seconds[part] for part in FILES)
    return [
        {"what": f"  {said}", "value": value, "unit": "s", "status": ""} for said, value in seconds.items()
    ]
