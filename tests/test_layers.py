"""Imports go down or sideways in the layers of the design, never up; and the command line answers without
what is heavy.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "o3dls"
LAYERS = {
    "errors": 0,
    "geometry": 0,
    "levelset": 1,
    "registration": 1,
    "case": 2,
    "estimate": 2,
    "places": 2,
    "io": 2,
    "extract": 3,
    "evaluate": 3,
    "validity": 3,
    "transfer": 3,
    "open3d_steps": 3,
    "conversion": 3,
    "parameters": 4,
    "stage": 4,
    "stages": 4,
    "catalogue": 4,
    "start": 5,
    "crossval": 5,
    "pipeline": 5,
    "pipeline_file": 5,
    "run": 5,
    "run_folder": 5,
    "surface_fields": 5,
    "tables": 5,
    "workers": 5,
    "report": 6,
    "export": 6,
    "view": 6,
    "live": 6,
    "batch": 6,
    "open3d_api": 6,
    "paper": 6,
    "doctor": 6,
    "resources": 0,
    "cli": 7,
    "cli_runs": 7,
    "cli_files": 7,
    "cli_words": 7,
    "__main__": 7,
}
HEAVY = {"open3d", "pymeshlab", "trimesh", "numba", "matplotlib", "scipy"}


def modules() -> list[Path]:
    return sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def unit(path: Path) -> str:
    """The module or package directly under o3dls that a file belongs to."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports(path: Path) -> set[str]:
    """Names under o3dls that a file imports, wherever in the file; what is only for type checkers does not
    count.
    """
    found = set()
    here = ("o3dls", *path.relative_to(PACKAGE).with_suffix("").parts)
    for node in running(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = (
                (*here[: len(here) - node.level], *(node.module or "").split("."))
                if node.level
                else (node.module or "").split(".")
            )
            name = ".".join(filter(None, base))
            found |= {f"{name}.{alias.name}" for alias in node.names} if name == "o3dls" else {name}
    return {name.split(".")[1] for name in found if name.startswith("o3dls.")} & set(LAYERS)


def running(node: ast.AST) -> Iterator[ast.AST]:
    """The node and everything in it that runs: all but `if TYPE_CHECKING` blocks."""
    yield node
    for child in ast.iter_child_nodes(node):
        if not (
            isinstance(child, ast.If)
            and isinstance(child.test, ast.Name)
            and child.test.id == "TYPE_CHECKING"
        ):
            yield from running(child)


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_never_go_up(path: Path) -> None:
    assert unit(path) in LAYERS, f"{unit(path)} stands in no layer: add it to DESIGN's table and to LAYERS"
    up = {name for name in imports(path) if LAYERS[name] > LAYERS[unit(path)]}
    assert not up, f"layer {LAYERS[unit(path)]} imports {up}"


def test_no_package_of_ours_imports_the_generators() -> None:
    for path in modules():
        assert "data_synth" not in path.read_text(encoding="utf-8"), path


@pytest.mark.parametrize(
    "path", [p for p in modules() if unit(p) == "levelset" or unit(p) == "registration"], ids=lambda p: p.name
)
def test_the_numerics_know_neither_files_nor_open3d(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for word in ("open3d", "pymeshlab", "from pathlib", "import io", "open("):
        assert word not in text, word


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["stages"], ["check", "PIPELINE"]])
def test_nothing_heavy_is_imported_to_answer(arguments: list[str]) -> None:
    from o3dls.resources import pipeline_file

    given = [str(pipeline_file("default")) if a == "PIPELINE" else a for a in arguments]
    code = (
        f"import sys; from o3dls.cli.main import answer; code = answer({given!r}); "
        f"print(sorted({HEAVY!r} & set(sys.modules)), code)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[] 0", done.stdout + done.stderr
