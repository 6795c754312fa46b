"""What mends a warning of a run, and in which step of the app that is done."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple
from urllib.parse import quote

from ..report.markup import Html, tag
from ..run_warning import RunWarning


class Mend(NamedTuple):
    """This is what to do about a warning, and the step in which it is done; no step: outside of the app."""

    words: str
    step: str = ""


BRING, PLACE, FUSE = "1 Bring", "2 Place", "3 Fuse"
ANCHORS = {PLACE: "placing", FUSE: "fusing"}  # sections of the page of a case
MENDS: Mapping[str, Mend] = {
    "start-pose-doubtful": Mend("mark three pairs of places, or find the pose", PLACE),
    "component-without-points": Mend("choose the label, or bring the piece, of this chamber alone", BRING),
    "points-on-a-ball": Mend("bring prior and map of one patient and one chamber, in the right units", BRING),
    "points-beside-the-wall": Mend("correct the names of the landmarks, or bring the blood pool", BRING),
    "large-noise": Mend("look whether the prior stands right, then leave out points without contact", PLACE),
    "small-noise": Mend("export the measured places, in the order in which they were taken", BRING),
    "landmark-not-used": Mend("mark this landmark again, or correct its name", BRING),
    "landmark-names-doubtful": Mend("call them LSPV, LIPV, RSPV or RIPV", BRING),
    "values-missing": Mend("nothing; these values count as missing"),
    "weak-direction": Mend("mark pairs, or take points that resist this direction", PLACE),
    "uncertain-pose": Mend("mark three pairs of places", PLACE),
    "prior-reduced": Mend("nothing; your file is not changed"),
    "points-far-off": Mend("leave out the points of other chambers, and bring the map again", BRING),
    "crumpled-prior": Mend("bring the label volume itself, or a smoother surface", BRING),
    "small-components": Mend("choose the one piece that is the chamber", BRING),
    "landmark-swapped-place": Mend("correct its name, or leave the landmark out", BRING),
    "no-landmark-start": Mend("bring three landmark pairs that are not on a line", BRING),
    "duplicate-points": Mend("nothing, unless most of the map is repeated: then export it again", BRING),
    "sigma-range": Mend("give the column sigma in the unit of the coordinates", BRING),
    "sigma-missing": Mend("fill the column sigma in, or leave it out", BRING),
    "many-outliers": Mend("mark pairs, or find the pose; then look for points of another chamber", PLACE),
    "captured-points": Mend("leave out points of structures that the prior lacks", BRING),
    "stretched-wall": Mend("leave out points of another chamber, or bring a prior with that vein", BRING),
    "volume-changed": Mend("check units and frame of prior and map", BRING),
    "prior-of-another": Mend("bring it as the template that it is, or look whether it stands right", PLACE),
    "alternative-start": Mend("mark pairs of places, or take more points", PLACE),
    "alternative-points": Mend("leave out the points that it names, if they had no contact", BRING),
    "map-shift": Mend("take the shift out, by map_shift of the stage deform in the own pipeline", FUSE),
    "errors-together": Mend("nothing; keep the points in the order in which they were taken"),
    "order-lost": Mend("export the points in the order in which they were taken, or with their times", BRING),
    "outdated-amplitudes": Mend("fuse all points anew", FUSE),
    "topology-changed": Mend("if the part is right as it was, leave topology out of the own pipeline", FUSE),
    "self-intersection-repaired": Mend("bring a prior that does not intersect itself there", BRING),
    "mesh-differs": Mend("a smaller level_set.spacing in the own pipeline", FUSE),
    "parts-lost": Mend("a smaller level_set.spacing in the own pipeline", FUSE),
    "stage-rejected": Mend("nothing; the earlier estimate is the result"),
    "stage-kept": Mend("leave keep_last out of the own pipeline", FUSE),
    "other": Mend("read the sentence; the package of that stage explains it"),
}


def list_warnings(found: Sequence[RunWarning], case: str | None) -> Html | None:
    """List warnings, each with what mends it and a link to the step; case: the folder that was run, None
    where it is not in the folder of the app.
    """
    lines = []
    for one in found:
        words, step = MENDS[one.code]
        target = _target_of(step, case)
        link = tag("a", step, href=target) if target else None
        lines.append(tag("li", one.sentence, tag("br"), "What mends it: ", words, ". ", link))
    return tag("ul", *lines, class_="mends") if lines else None


def _target_of(step: str, case: str | None) -> str | None:
    """Return where a step is done: on the page of the case, or on the first page."""
    if step in ANCHORS:
        return f"case?folder={quote(case)}#{ANCHORS[step]}" if case else None
    return "./#bring" if step else None
