"""The Python that has slicer-core, 3D Slicer's libraries: one of its own, since it brings its own vtk."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from o3dls.arrays import Array

ROOT = Path(__file__).resolve().parents[1]
SCRIPT = ROOT / "tests/in_slicer.py"


def slicer_python() -> Path:
    """Return it, or skip the test with a word."""
    python = Path(os.environ.get("O3DLS_SLICER_CORE", ROOT / ".dev/slicer/bin/python"))
    if not python.exists():
        pytest.skip(
            f"no slicer-core in {python}: python3 -m venv .dev/slicer && .dev/slicer/bin/pip install "
            "slicer-core (extra slicer-test), or set O3DLS_SLICER_CORE"
        )
    return python


def in_slicer(*arguments: str | Path) -> None:
    """Run tests/in_slicer.py there."""
    python = slicer_python()
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    done = subprocess.run(
        [python, SCRIPT, *arguments], capture_output=True, text=True, env=environment, timeout=300
    )
    assert done.returncode == 0, done.stderr[-3000:]


def moved_by_slicer(file: Path, points: Array) -> tuple[Array, Array]:
    """Return points (n, 3) in LPS under a transform file of a node, to the world, and from it."""
    turn = np.array([-1.0, -1.0, 1.0])
    given, out = file.with_suffix(".in.npz"), file.with_suffix(".out.npz")
    np.savez(given, points=points * turn)
    in_slicer("transform", file, given, out)
    with np.load(out) as found:
        return found["to_world"] * turn, found["from_world"] * turn
