"""What more than one test file needs."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
# as on the command line; on a busy machine threads of linear algebra wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
if "PYTEST_XDIST_WORKER" in os.environ:  # the processes share the cores; tests of threads ask for theirs
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
# processes that tests start find the modules that tests share
os.environ["PYTHONPATH"] = os.pathsep.join(
    filter(None, [str(Path(__file__).parent), os.environ.get("PYTHONPATH")])
)


SLOW = frozenset((Path(__file__).parent / "slow_tests.txt").read_text(encoding="utf-8").splitlines())
LONG = (
    "test_paper.py",
    "test_site.py",
    "test_tutorial.py",
    "test_tutorial_carto.py",
    "test_readme.py",
    "test_cli.py",
    "test_topology.py",
)


@pytest.hookimpl(tryfirst=True)  # before pytest leaves out what is marked
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests that slow_tests.txt names are slow. Files that take long come first, so that no process is left
    alone with one of them at the end.
    """
    for item in items:
        if {item.nodeid.removeprefix("tests/"), item.nodeid.removeprefix("tests/").split("[")[0]} & SLOW:
            item.add_marker("slow")
    items.sort(key=lambda item: item.path.name not in LONG)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of third-party and phantom data, which is not in the repository; O3DLS_DATA names another
    place.
    """
    folder = Path(os.environ.get("O3DLS_DATA", ROOT / "../shared/data")).resolve()
    if not folder.is_dir():
        pytest.skip(f"no data folder {folder}: set O3DLS_DATA")
    return folder
