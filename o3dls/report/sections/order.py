"""The sections of the report in their order; each leaves itself out where it has nothing to say."""

from __future__ import annotations

from ...parallel import both
from ..checks import checks
from ..drawing.distance_charts import spread_section
from ..drawing.pictures import static_pictures
from ..drawing.scene import scene
from ..grading.doubts import NAMED, doubted_regions
from ..mapping.measures import measured_section
from ..mapping.sections import next_section, region_section
from ..markup import join, tag
from ..page_parts import viewer_scripts
from ..section import Maker, Section
from ..stacks.section import image_section
from ..subject import Subject
from .certainty import calibration_section, pose_section
from .contribution import contribution_section
from .course import course_section
from .cross_sections import slice_section
from .electrical import activation_section, electrical_section
from .methods import methods_section
from .outcome import outcome_section
from .outlines import outline_section
from .paired import landmark_section, paired_section
from .provenance import made_section
from .scores import score_section, validity_section
from .sweep import sweep_section


def picture_section(subject: Subject) -> Section | None:
    """Show the estimates side by side in 3D, with static pictures for browsers that cannot."""
    if subject.case.dimension == 2:
        return None
    shapes = (
        "Discs: eam points; squares: ablation points; diamonds: fitted points that were judged "
        "outliers. Hatched: no points here, shape from the image alone. Grey: no value of this colour."
    )
    left = len(subject.runs) - len(subject.shown)
    more = (
        f" The last {len(subject.shown)} runs are shown; the tables have all {len(subject.runs)}."
        if left > 0
        else ""
    )
    note = tag("p", shapes + more, class_="soft")
    doubts = doubted_regions(subject, checks(subject))[:NAMED]
    # compiled loops fill pictures on one core while the scene is packed on the other
    whole, flat = both(lambda: scene(subject, doubts), lambda: static_pictures(subject))
    drawn = join(flat, viewer_scripts(whole), note)
    return Section("pictures", "Side by side", drawn)


SECTIONS: tuple[Maker, ...] = (
    picture_section,
    outline_section,
    outcome_section,
    image_section,
    next_section,
    score_section,
    contribution_section,
    paired_section,
    spread_section,
    slice_section,
    region_section,
    landmark_section,
    pose_section,
    calibration_section,
    electrical_section,
    activation_section,
    measured_section,
    validity_section,
    course_section,
    sweep_section,
    methods_section,
    made_section,
)
