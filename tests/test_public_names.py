"""What `import o3dls` offers: the same names to Python, to people who look, and to type checkers."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest
from conftest import ROOT

import o3dls

STUB = ROOT / "o3dls" / "__init__.pyi"
BLOCK = re.compile(r"(?P<spared><!-- not run: [^\n]+ -->\n)?```python\n(?P<code>.*?)```", re.DOTALL)
SHOWN = ("README.md", "docs/python.md", "docs/architecture.md", "docs/tutorial_python.md")

RIGHT = """\
from pathlib import Path

import numpy as np

import o3dls
from o3dls import ICP, Deform, Estimate, Export, Landmarks, Phases, Pipeline, Report, Run, Surface, read_case

stages = [Landmarks(), ICP(reject="trimmed", keep=0.9, as_="first"), ICP(reject=("mad", "trimmed"))]
writes = [Report(pdf=True), Export(grid=Path("mri.nii"))]
pipeline = Pipeline([*stages, ICP(scale_sd=None), Deform(vector=(1, 0.5))], writes, folds=0)
others = [o3dls.GlobalPose(), o3dls.Recorded(), o3dls.Topology(), o3dls.LevelSet(), o3dls.PaperLevelSet()]
phases = Phases(deform=Deform(iterations=20), after="icp")
run: Run = pipeline.run(read_case(Path("case")))
estimate: Estimate = run.estimates["deform"]
surface: Surface = o3dls.surface_of((np.zeros((3, 3)), np.zeros((1, 3))))
mesh = o3dls.register(surface, np.zeros((9, 3)), stages=stages).to("trimesh")
voxels: o3dls.Voxels = o3dls.voxelise(mesh, 1.0, margin=2)
near: o3dls.SignedDistance = o3dls.signed_distance(surface, 0.5)
case: o3dls.Case = o3dls.case_of(surface, np.zeros((9, 3)), units="mm", label=2)
version: str = o3dls.__version__
"""
# a line each, that both checkers must report
WRONG = """\
o3dls.ICP(nonsense=3)
o3dls.ICP(iterations="x")
o3dls.ICP(0.9)
o3dls.ICP(metric="point_to_plan")
o3dls.ICP(reject=("trimmed", "worst"))
o3dls.Deform(map_shift=True)
o3dls.Phases(deform=o3dls.ICP())
o3dls.Export(format="stll")
o3dls.Pipeline([o3dls.Report()])
o3dls.Pipeline([o3dls.ICP()], fold=0)
o3dls.Pipeline([o3dls.ICP()]).run("case")
o3dls.Pipeline([o3dls.ICP()]).run(o3dls.read_case(Path("case"))).estimate
o3dls.register(1, 2, landmark={})
o3dls.case_of(1, 2, unit="mm")
o3dls.surface_of(1, label="left atrium")
o3dls.read_cas(Path("case"))
o3dls.voxelise(1, spacing="1")
o3dls.signed_distance(1, 0.5, with_=2.0)
icp: int = o3dls.ICP()
"""
HEAD = "from pathlib import Path\n\nimport o3dls\n\n"


def imports() -> dict[str, str]:
    """Module by name of what the stub gives again."""
    found = {}
    for node in ast.parse(STUB.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            assert node.level == 1
            for one in node.names:
                assert one.asname == one.name  # else it is private to checkers
                found[one.name] = str(node.module)
    return found


def test_type_checkers_see_the_public_names_and_no_other() -> None:
    assert imports() == o3dls.PUBLIC


def test_dir_shows_the_public_names_and_no_other() -> None:
    assert {name for name in dir(o3dls) if not name.startswith("__")} == set(o3dls.PUBLIC)
    assert "__version__" in dir(o3dls)
    assert all(hasattr(o3dls, name) for name in dir(o3dls))


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of scripts as users write them: right.py, wrong.py, and what the documents show."""
    folder = tmp_path_factory.mktemp("scripts")
    (folder / "right.py").write_text(RIGHT, encoding="utf-8")
    (folder / "wrong.py").write_text(HEAD + WRONG, encoding="utf-8")
    blocks = [
        block["code"]
        for page in SHOWN
        for block in BLOCK.finditer((ROOT / page).read_text(encoding="utf-8"))
        # Open3D's own types refuse names of files as text
        if not block["spared"] and "open3d" not in block["code"]
    ]
    assert len(blocks) > 3
    for number, code in enumerate(blocks):
        (folder / f"shown_{number}.py").write_text(code, encoding="utf-8")
    return folder


def by_mypy(folder: Path, cache: Path) -> dict[str, set[int]]:
    """Lines that mypy reports by file, without a plugin and without this project's settings."""
    options = ["--config-file=", "--follow-imports=silent", f"--cache-dir={cache}", "--no-error-summary"]
    command = [sys.executable, "-m", "mypy", *options, *sorted(path.name for path in folder.glob("*.py"))]
    env = {"MYPYPATH": str(ROOT), "PATH": ""}
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 1), done.stderr
    return lines(re.findall(r"^(\w+\.py):(\d+): error: ", done.stdout, re.MULTILINE))


def by_pyright(folder: Path) -> dict[str, set[int]]:
    """Lines that pyright reports by file; basedpyright is pyright with its own node."""
    settings = {"extraPaths": [str(ROOT)], "typeCheckingMode": "standard"}
    (folder / "pyrightconfig.json").write_text(json.dumps(settings), encoding="utf-8")
    command = [sys.executable, "-m", "basedpyright", "--outputjson", "--pythonpath", sys.executable]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 1), done.stderr
    told = json.loads(done.stdout)["generalDiagnostics"]
    return lines(
        (Path(one["file"]).name, one["range"]["start"]["line"] + 1)
        for one in told
        if one["severity"] == "error"
    )


def lines(found: Iterable[tuple[str, str | int]]) -> dict[str, set[int]]:
    told: dict[str, set[int]] = {}
    for file, line in found:
        told.setdefault(file, set()).add(int(line))
    return told


def wanted() -> dict[str, set[int]]:
    first = len(HEAD.splitlines()) + 1
    return {"wrong.py": set(range(first, first + len(WRONG.splitlines())))}


def test_mypy_reports_every_wrong_line_of_a_user_and_no_other(
    scripts: Path, pytestconfig: pytest.Config
) -> None:
    assert pytestconfig.cache is not None
    # half a minute the first time, seconds from then on
    assert by_mypy(scripts, pytestconfig.cache.mkdir("mypy")) == wanted()


def test_pyright_reports_every_wrong_line_of_a_user_and_no_other(scripts: Path) -> None:
    pytest.importorskip("basedpyright", reason="basedpyright is not installed")
    assert by_pyright(scripts) == wanted()
