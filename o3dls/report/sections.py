"""The sections of the report in their order; each leaves itself out where it has nothing to say."""

from __future__ import annotations

from .figures import pictures_png
from .markup import join
from .page_parts import image, viewer_scripts
from .provenance import made_section
from .scene import scene
from .score_tables import score_section, validity_section
from .section import Maker, Section
from .subject import Subject


def picture_section(subject: Subject) -> Section | None:
    """Estimates side by side in 3D, with static pictures for browsers that cannot."""
    if subject.case.dimension == 2:
        return None
    static = image(pictures_png(subject), f"{' and '.join(subject.shown)} side by side, from the front, in one colour scale")
    return Section("pictures", "Side by side", join(static, viewer_scripts(scene(subject))))


SECTIONS: tuple[Maker, ...] = (picture_section, score_section, validity_section, made_section)
