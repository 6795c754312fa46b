"""The sections of the report in their order; each leaves itself out where it has nothing to say."""

from __future__ import annotations

from .course_section import course_section
from .distance_charts import spread_section
from .electrical_section import electrical_section
from .figures import pictures_png
from .markup import join
from .outline_sections import outline_section, slice_section
from .page_parts import image, viewer_scripts
from .paired_section import landmark_section, paired_section
from .provenance import made_section
from .scene import scene
from .score_tables import score_section, validity_section
from .section import Maker, Section
from .subject import Subject
from .sweep_section import sweep_section


def picture_section(subject: Subject) -> Section | None:
    """Estimates side by side in 3D, with static pictures for browsers that cannot."""
    if subject.case.dimension == 2:
        return None
    static = image(pictures_png(subject), f"{' and '.join(subject.shown)} side by side, from the front, in one colour scale")
    return Section("pictures", "Side by side", join(static, viewer_scripts(scene(subject))))


SECTIONS: tuple[Maker, ...] = (
    picture_section,
    outline_section,
    score_section,
    paired_section,
    spread_section,
    slice_section,
    landmark_section,
    electrical_section,
    validity_section,
    course_section,
    sweep_section,
    made_section,
)
