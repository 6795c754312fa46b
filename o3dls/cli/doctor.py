"""Is this machine able to run o3dls: each check says what was found, and where it fails, the command that
fixes it.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np

from ..case import Case, Points
from ..errors import O3dlsError
from ..geometry.surface import outline

MODULES = (
    "numpy",
    "scipy",
    "numba",
    "open3d",
    "pymeshlab",
    "trimesh",
    "nibabel",
    "pydantic",
    "click",
    "matplotlib",
)

FILTERS = (  # of pymeshlab, all that o3dls calls; a test looks for others in the source
    "apply_coord_taubin_smoothing",
    "compute_selection_by_self_intersections_per_face",
    "meshing_decimation_quadric_edge_collapse",
    "meshing_remove_connected_component_by_face_number",
    "meshing_remove_unreferenced_vertices",
    "meshing_repair_non_manifold_edges",
)

PACKAGE_OF = {  # Debian's and Ubuntu's package of each shared library that the wheels expect of the system
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libOpenGL.so.0": "libopengl0",
    "libidn2.so.0": "libidn2-0",
    "libudev.so.1": "libudev1",
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libX11.so.6": "libx11-6",
}

RENDER = """
import open3d as o3d
renderer = o3d.visualization.rendering.OffscreenRenderer(32, 32)
material = o3d.visualization.rendering.MaterialRecord()
renderer.scene.add_geometry("box", o3d.geometry.TriangleMesh.create_box(), material)
renderer.render_to_image()
"""
RENDER_SECONDS = 30.0


@dataclass(frozen=True)
class Check:
    """A check is one finding of `o3dls doctor`; `remedy` says what to do about it, and is empty where all is
    well. Without what is not `needed` o3dls still does its work.
    """

    name: str
    found: str
    remedy: str = ""
    needed: bool = True

    @property
    def ok(self) -> bool:
        return not self.remedy

    def __str__(self) -> str:
        mark = "ok     " if self.ok else "FAULT  " if self.needed else "without"
        return f"{mark} {self.name}: {self.found}" + (
            f"\n        to fix this, run: {self.remedy}" if self.remedy else ""
        )


def diagnose() -> list[Check]:
    """Make every check, in the order in which faults should be remedied."""
    return [
        _check_python(),
        *map(check_module, MODULES),
        _check_open3d(),
        _check_plugins(),
        _check_filters(),
        _check_kernel_cache(),
        _check_renderer(),
    ]


def compile_loops() -> float:
    """Compile what the default pipeline and its report run, in 3D and in 2D, by doing so once: numba keeps it
    for those who run this version, with this Python, on this kind of processor. Seconds.
    """
    from ..io.case_reader import read_case
    from ..pipeline.file import default_pipeline
    from ..resources import demo_case

    begin = perf_counter()
    plan = replace(default_pipeline(), folds=0)
    for case in (read_case(demo_case()), _plane_case()):
        with TemporaryDirectory(prefix="o3dls-") as folder:
            plan.allowed_by(case).run(case).write(Path(folder) / "run")
    return perf_counter() - begin


def _plane_case() -> Case:
    """Make a case in 2D: an ellipse, and points on one that is wider."""
    angle = np.linspace(0.0, 2 * np.pi, 120, endpoint=False)
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    points = around[::2] * [24.0, 16.0]
    return Case("plane", outline(around * [20.0, 15.0]), Points(points, np.full(len(points), "eam")))


def _check_python() -> Check:
    found = f"{sys.version.split()[0]} in {sys.prefix}"
    return Check(
        "python",
        found,
        "" if sys.version_info >= (3, 11) else "a virtual environment of Python 3.11 or newer",
    )


def check_module(name: str) -> Check:
    """Check that a library can be imported."""
    try:
        import_module(name)
    except (ImportError, OSError) as error:
        return Check(
            name,
            f"cannot be imported: {_error_line(error)}",
            _apt_command(str(error)) or "python -m pip install -c constraints.txt .",
        )
    return Check(name, _find_version(name) or _find_version(f"{name}-cpu") or "installed")


def _find_version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _error_line(error: Exception) -> str:
    """Return the error on one line."""
    return " ".join(str(error).split()) or type(error).__name__


def _apt_command(message: str) -> str:
    """Return the command that installs the shared libraries named in a loader's message, or nothing."""
    packages = [package for library, package in PACKAGE_OF.items() if library in message]
    return f"sudo apt-get install {' '.join(packages)}" if packages else ""


def _check_open3d() -> Check:
    both = [name for name in ("open3d", "open3d-cpu") if _find_version(name)]
    remedy = (
        "python -m pip uninstall -y open3d open3d-cpu; python -m pip install -c constraints.txt ."
        if len(both) > 1
        else ""
    )
    return Check(
        "open3d's distribution", " and ".join(both) + (" share one folder" if remedy else ""), remedy
    )


def _check_plugins() -> Check:
    from ..plugins.plugin import GROUPS, load, registered

    try:
        names = [(kind, name) for kind, group in GROUPS.items() for name in registered(group)]
        for kind, name in names:
            load(kind, name)
    except (ImportError, AttributeError, O3dlsError) as error:
        return Check("stages and writers", _error_line(error), "python -m pip install -c constraints.txt .")
    return Check(
        "stages and writers",
        ", ".join(name for _, name in names),
        "" if names else "python -m pip install -c constraints.txt .",
    )


def _check_filters() -> Check:
    def missing() -> Iterator[str]:
        import pymeshlab

        there = set(pymeshlab.filter_list())
        yield from (name for name in FILTERS if name not in there)

    # Without libOpenGL pymeshlab can be imported, but leaves out the plugins that need it.
    remedy = "sudo apt-get install libgl1 libopengl0"
    return _try_check(
        "pymeshlab's filters", lambda: ", ".join(missing()), f"all {len(FILTERS)} there", "missing: ", remedy
    )


def _check_kernel_cache() -> Check:
    def unwritable() -> str:
        from numba.core.caching import FunctionCache

        from ..geometry.closest_point import ClosestPoint

        # numba's cache looks for a writable folder, and raises where there is none
        FunctionCache(ClosestPoint.query)
        return ""

    return _try_check(
        "kernel cache",
        unwritable,
        "writable",
        "",
        "export NUMBA_CACHE_DIR=FOLDER, with a folder that you may write",
    )


def _try_check(name: str, fault: Callable[[], str], well: str, prefix: str, remedy: str) -> Check:
    """Check something that answers with a fault, an empty text, or an error."""
    try:
        found = fault()
    except (ImportError, OSError, RuntimeError) as error:
        return Check(name, _error_line(error), _apt_command(str(error)) or remedy)
    return Check(name, prefix + found, remedy) if found else Check(name, well)


def _check_renderer() -> Check:
    """Check Open3D's renderer, in a process of its own: it is known to hang. o3dls draws without it."""
    name, remedy = "open3d's renderer", "sudo apt-get install libegl1 libvulkan1 mesa-vulkan-drivers"
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", RENDER],  # -P: what lies in the working folder is not run
            capture_output=True,
            text=True,
            timeout=RENDER_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Check(name, f"no picture within {RENDER_SECONDS:g} s", remedy, needed=False)
    if done.returncode:
        said = done.stderr.strip().splitlines() or ["no message"]
        return Check(
            name,
            f"ended with code {done.returncode}: {said[-1]}",
            _apt_command(done.stderr) or remedy,
            needed=False,
        )
    return Check(name, "draws", needed=False)
