"""The shape of the package: imports go down the layers and never in a circle, modules stay small enough to be
read, numbers of the method stand in settings classes; and the command line answers without what is heavy.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "o3dls"
# From below to above; a package imports those before it, and no other.
LAYERS = (
    "kernel_cache",
    "arrays",
    "errors",
    "places",
    "run_warning",
    "child_processes",
    "parallel",
    "cholesky",
    "settings",
    "geometry",
    "noise",
    "registration",
    "motion",
    "levelset",
    "reconstruction",
    "topology",
    "columns",
    "quantities",
    "case",
    "estimate",
    "resources",
    "io",
    "adapters",
    "evaluation",
    "plugins",
    "stages",
    "runs",
    "pipeline",
    "report",
    "open3d_api",
    "paper",
    "web",
    "live",
    "app",
    "cli",
    "__main__",
)
# Inside packages that have folders, from below to above: a line is one folder, or modules that stand beside
# the folders; "." are those modules that no other line names. A line imports those before it, and no other.
ROOMS = {
    "io": (
        "kinds text manifest atomic documents",
        "tables/",
        "table markups case_settings",
        "meshes/",
        "clouds/",
        "meshes/carto/",
        "images/",
        "grey/",
        "matlab/",
        ".",  # surfaces, which chooses among them; transforms; the case
        "mapping/",
        "scenes/",
    ),
    "evaluation": (".", "measures/", "activation/", "changes/", "segments/"),
    "levelset": ("grid/", "."),
    "live": (".", "sources/"),
    "motion": (
        "settings map_shift_settings drift_settings",
        "field/",
        "wall/",
        ".",
        "map_shift/",
        "off_wall/",
    ),
    "reconstruction": ("settings shape_settings neighbours", "field/", "points/", "shape/", "."),
    "report": (
        "markup palette",
        "surfaces/",
        "subject section expected shape_words contribution wall_parts verdict document page_parts",
        "mapping/",
        "grading/",
        "checks",
        "drawing/",
        "stacks/",
        "sections/",
        "page",
        "cohort/",
        ".",  # writer, and the ways to look at a page
    ),
    "runs": (".", "export/", "image/", "live"),
}
KERNELS = (
    "geometry",
    "noise",
    "registration",
    "motion",
    "levelset",
    "reconstruction",
    "topology",
)  # arrays in, arrays out
HEAVY = {"open3d", "pymeshlab", "trimesh", "numba", "matplotlib", "scipy", "starlette", "uvicorn"}
MOST_MODULES = 16
MOST_LINES = 260
# Imports that would close a circle or go up, each with its reason. There is none.
EXCEPTIONS: Mapping[tuple[str, str], str] = {}


def modules() -> dict[str, Path]:
    """Files by dotted name; the package's own `__init__` apart, which imports on demand."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = ("o3dls", *path.relative_to(PACKAGE).with_suffix("").parts)
        found[".".join(part for part in parts if part != "__init__")] = path
    del found["o3dls"]
    return found


MODULES = modules()


def imports(name: str) -> set[str]:
    """Modules of ours that one imports: at its top, inside functions, or for type checkers alone."""
    path = MODULES[name]
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            source = ".".join([*base, *filter(None, [node.module])])
            found |= {f"{source}.{alias.name}" for alias in node.names} | {source}
    return (found & MODULES.keys()) - {name}


def layer(name: str) -> int:
    return LAYERS.index(name.split(".")[1])


@pytest.mark.parametrize("name", MODULES)
def test_imports_go_down(name: str) -> None:
    up = {
        other
        for other in imports(name)
        if layer(other) >= layer(name) and other.split(".")[1] != name.split(".")[1]
    }
    assert not {other for other in up if (name, other) not in EXCEPTIONS}


def test_no_modules_import_each_other_in_a_circle() -> None:
    left = {name: imports(name) - {o for n, o in EXCEPTIONS if n == name} for name in MODULES}
    while free := {name for name, needs in left.items() if not needs & left.keys()}:
        left = {name: needs for name, needs in left.items() if name not in free}
    assert not left


def room(name: str) -> str:
    """The folder of a module inside its package, with a slash behind; the name of a module beside them."""
    parts = MODULES[name].relative_to(PACKAGE).with_suffix("").parts[1:]
    return "/".join(parts) if len(parts) == 1 else "/".join((*parts[:-1], ""))


def line(rooms: tuple[str, ...], room: str) -> int:
    named = next((k for k, one in enumerate(rooms) if room in one.split()), None)
    assert named is not None or not room.endswith("/"), f"{room} stands in no line"
    return rooms.index(".") if named is None else named


def upward(rooms: tuple[str, ...], arrows: Iterable[tuple[str, str]]) -> set[tuple[str, str]]:
    """Arrows from a room to one that stands in a later line."""
    return {(a, b) for a, b in arrows if line(rooms, a) < line(rooms, b)}


def arrows(package: str) -> dict[tuple[str, str], tuple[str, str]]:
    """A pair of modules of a package by rooms, where one imports the other."""
    inside = [
        name for name, path in MODULES.items() if name.split(".")[1] == package and path.name != "__init__.py"
    ]
    return {
        (room(name), room(other)): (name, other)
        for name in inside
        for other in imports(name).intersection(inside)
        if room(name) != room(other)
    }


def test_packages_that_have_folders_have_an_order_of_them() -> None:
    assert set(ROOMS) == {path.parents[1].name for path in PACKAGE.glob("*/*/__init__.py")}
    for package, rooms in ROOMS.items():
        folders = {
            f"{path.parent.relative_to(PACKAGE / package).as_posix()}/"
            for path in (PACKAGE / package).rglob("*/__init__.py")
        }
        modules = {path.stem for path in (PACKAGE / package).glob("*.py")} - {"__init__"}
        named = [one for some in rooms for one in some.split() if one != "."]
        assert len(named) == len(set(named)), package
        assert folders <= set(named) <= folders | modules, package
        # each folder has a line of its own, so that of two one is the lower
        assert not [some for some in rooms if "/" in some and " " in some], package


@pytest.mark.parametrize("package", ROOMS)
def test_imports_between_the_folders_of_a_package_go_down(package: str) -> None:
    found = arrows(package)
    assert found
    assert not {found[one] for one in upward(ROOMS[package], found)}


def test_of_a_circle_between_folders_one_arrow_goes_up() -> None:
    rooms = ROOMS["report"]
    assert not upward(rooms, [("sections/", "drawing/"), ("drawing/", "subject"), ("writer", "page")])
    assert upward(rooms, [("sections/", "drawing/"), ("drawing/", "sections/")]) == {
        ("drawing/", "sections/")
    }
    assert upward(rooms, [("subject", "drawing/"), ("page", "writer")]) == {
        ("subject", "drawing/"),
        ("page", "writer"),
    }


@pytest.mark.parametrize("order", ["forward", "backward"])
def test_modules_can_be_imported_in_any_order(order: str) -> None:
    names = sorted(set(MODULES) - {"o3dls.__main__"}, reverse=order == "backward")
    code = "import importlib, sys\nfor name in sys.argv[1:]: importlib.import_module(name)"
    subprocess.run([sys.executable, "-c", code, *names], check=True)


@pytest.mark.parametrize("package", ["app", "live", "paper"])
def test_only_the_command_line_imports_what_stands_alone(package: str) -> None:
    importing = {
        name.split(".")[1]
        for name in MODULES
        if any(other.split(".")[1] == package for other in imports(name))
    }
    assert importing == {package, "cli"}
    of_whoever_imports_o3dls = (PACKAGE / "__init__.py").read_text(encoding="utf-8")
    assert f'"{package}.' not in of_whoever_imports_o3dls


def test_only_the_paper_imports_the_generators() -> None:
    for name, path in MODULES.items():
        assert name.startswith("o3dls.paper") or "data_synth" not in path.read_text(encoding="utf-8"), name


@pytest.mark.parametrize("name", MODULES)
def test_private_names_stay_in_their_module(name: str) -> None:
    for node in ast.walk(ast.parse(MODULES[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module != "__future__":
            assert not [
                alias.name
                for alias in node.names
                if alias.name.startswith("_") and not alias.name.startswith("__")
            ]


def test_packages_and_modules_are_small_enough_to_be_read() -> None:
    for folder in {path.parent for path in MODULES.values()}:
        assert len([path for path in folder.glob("*.py") if path.name != "__init__.py"]) <= MOST_MODULES
    lines = {name: path.read_text(encoding="utf-8").count("\n") for name, path in MODULES.items()}
    assert not {name: count for name, count in lines.items() if count > MOST_LINES}


@pytest.mark.parametrize("folder", sorted({path.parent for path in MODULES.values()} - {PACKAGE}), ids=str)
def test_every_package_says_what_lives_there(folder: Path) -> None:
    text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))) or ""
    assert text


@pytest.mark.parametrize("name", [name for name in MODULES if name.split(".")[1] in KERNELS])
def test_the_numerics_know_neither_files_nor_open3d(name: str) -> None:
    text = MODULES[name].read_text(encoding="utf-8")
    for word in ("open3d", "pymeshlab", "from pathlib", "import io", "open("):
        assert word not in text, word


def constants(name: str) -> Iterator[str]:
    """Upper-case names of numbers at the top of a module."""
    for node in ast.parse(MODULES[name].read_text(encoding="utf-8")).body:
        targets = (
            node.targets
            if isinstance(node, ast.Assign)
            else [node.target]
            if isinstance(node, ast.AnnAssign)
            else []
        )
        value = getattr(node, "value", None)
        numeric = value is not None and any(
            isinstance(part, ast.Constant) and type(part.value) in (int, float) for part in ast.walk(value)
        )
        for target in targets:
            yield from (
                part.id
                for part in ast.walk(target)
                if numeric and isinstance(part, ast.Name) and part.id.isupper()
            )


def test_numbers_of_the_method_stand_in_settings_classes() -> None:
    found = [
        f"{name}.{constant}"
        for name in MODULES
        if name.split(".")[1] in ("noise", "motion", "levelset", "reconstruction", "topology")
        for constant in constants(name)
    ]
    assert len(found) <= 30, found


@pytest.mark.parametrize(
    "arguments", [["--help"], ["run", "--help"], ["stages"], ["settings"], ["check", "PIPELINE"]]
)
def test_nothing_heavy_is_imported_to_answer(arguments: list[str]) -> None:
    from o3dls.resources import pipeline_file

    given = [str(pipeline_file("default")) if a == "PIPELINE" else a for a in arguments]
    code = (
        f"import sys; from o3dls.cli.main import answer; code = answer({given!r}); "
        f"print(sorted({HEAVY!r} & set(sys.modules)), code)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[] 0", done.stdout + done.stderr
