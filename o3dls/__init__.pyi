"""The public names as type checkers and editors see them; `__init__.py` imports each when it is used."""

from .adapters.case import case_of as case_of
from .adapters.objects import surface_of as surface_of
from .case import Case as Case
from .case import Points as Points
from .case import Truth as Truth
from .errors import InputError as InputError
from .errors import O3dlsError as O3dlsError
from .errors import PipelineError as PipelineError
from .errors import SolverError as SolverError
from .estimate import Estimate as Estimate
from .evaluation.next_places import suggest as suggest
from .geometry.surface import Surface as Surface
from .io.case_reader import read_case as read_case
from .io.case_writer import write_case as write_case
from .io.mapping.study_import import import_study as import_study
from .io.meshes.registry import read_surface as read_surface
from .io.meshes.registry import write_surface as write_surface
from .io.points import read_points as read_points
from .io.points import write_points as write_points
from .open3d_api import register as register
from .pipeline.file import default_pipeline as default_pipeline
from .pipeline.file import read_pipeline as read_pipeline
from .pipeline.pipeline import Pipeline as Pipeline
from .plugins.stage import Stage as Stage
from .report.writer import Report as Report
from .run_warning import RunWarning as RunWarning
from .runs.conversion import convert as convert
from .runs.export.writer import Export as Export
from .runs.folder import read_run as read_run
from .runs.run import Run as Run
from .runs.writers import Writer as Writer
from .stages.deform import Deform as Deform
from .stages.global_pose import GlobalPose as GlobalPose
from .stages.icp import ICP as ICP
from .stages.landmarks import Landmarks as Landmarks
from .stages.level_set import LevelSet as LevelSet
from .stages.phases import Phases as Phases
from .stages.recorded import Recorded as Recorded
from .stages.topology import Topology as Topology

__version__: str
