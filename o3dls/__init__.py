"""Level-set registration and reconstruction of an atrium from a prior surface and sparse points, on Open3D.

Not for clinical use.
"""

from __future__ import annotations

from . import kernel_cache

TYPE_CHECKING = False  # typing takes time, and until the command line listens Ctrl-C shows a traceback
if TYPE_CHECKING:
    from typing import Any

__version__ = "0.1.0"

PUBLIC = {
    "Case": "case",
    "Points": "case",
    "Truth": "case",
    "Estimate": "estimate",
    "SurfaceSamples": "motion.wall.samples",
    "RunWarning": "run_warning",
    "Surface": "geometry.surface",
    "Stage": "plugins.stage",
    "Writer": "runs.writers",
    "O3dlsError": "errors",
    "InputError": "errors",
    "PipelineError": "errors",
    "SolverError": "errors",
    "read_case": "io.case_reader",
    "write_case": "io.case_writer",
    "read_surface": "io.surfaces",
    "write_surface": "io.surfaces",
    "read_points": "io.points",
    "write_points": "io.points",
    "import_study": "io.mapping.study_import",
    "convert": "runs.conversion",
    "carry": "runs.export.carry",
    "Pipeline": "pipeline.pipeline",
    "read_pipeline": "pipeline.file",
    "default_pipeline": "pipeline.file",
    "Run": "runs.run",
    "read_run": "runs.folder",
    "Landmarks": "stages.landmarks",
    "ICP": "stages.icp",
    "GlobalPose": "stages.global_pose",
    "Recorded": "stages.recorded",
    "Deform": "stages.deform",
    "Topology": "stages.topology",
    "LevelSet": "stages.level_set",
    "PaperLevelSet": "stages.paper_level_set",
    "Phases": "stages.phases",
    "Report": "report.writer",
    "Export": "runs.export.writer",
    "suggest": "evaluation.next_places",
    "register": "open3d_api",
    "case_of": "adapters.case",
    "surface_of": "adapters.objects",
    "points_of": "adapters.objects",
    "to": "adapters.objects",
    "signed_distance": "adapters.voxels",
    "voxelise": "adapters.voxels",
    "Voxels": "adapters.voxels",
    "SignedDistance": "levelset.grid.distance",
}


kernel_cache.settle()  # before a module imports numba


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in PUBLIC:
        raise AttributeError(f"module 'o3dls' has no attribute '{name}'")
    return getattr(import_module(f"o3dls.{PUBLIC[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*PUBLIC, *(name for name in globals() if name.startswith("__"))])
