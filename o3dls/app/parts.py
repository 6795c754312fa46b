"""Parts of the app's pages: the frame that all share, lists, and the forms of the steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from html import escape
from importlib.resources import files
from pathlib import Path
from urllib.parse import quote

from .. import __version__
from ..errors import InputError
from ..registration.landmark_names import PLACES
from ..report.document import document
from ..report.markup import Html, join, tag
from ..report.page_parts import asset, viewer_code, viewer_started
from ..report.palette import variables
from .fuse import OWN, PRESETS, WRITES
from .pose import INIT
from .shelf import CASES, RUNS

BY_LANDMARKS = (
    "Landmarks of the case give the pose. Where one is wrong, correct it in its file, or make the case again "
    "without the landmarks of the prior and mark pairs here."
)
STYLES = ("report.css", "layout.css")
NOTICE = "Research use only. Not for clinical use."
STEPS = ("Bring", "Place", "Fuse", "Judge", "Take away")
SLOTS = (
    ("prior", "Prior", "the surface from MRI or CT, or a label volume (PLY, STL, VTP, NIfTI, NRRD, …)"),
    ("map", "Map", "a table of points, a study of CARTO or EnSite (zip or folder), or a file of OpenEP"),
    ("landmarks", "Landmarks, if there are any", "places named on the prior: of 3D Slicer, or name,x,y,z"),
    (
        "image",
        "Image, if you have it",
        "the grey image that the prior was segmented in: a file, or the folder of a DICOM series",
    ),
)
FOLDERS = ("map", "image")  # roles that a folder may have


def framed(
    title: str, body: Html, scripts: Sequence[str], *, step: int = 0, viewer: str | None = None
) -> str:
    """Write a whole page, in one of the steps, with its own scripts; viewer: the script that runs in the
    scope of the report's 3D viewer.
    """
    started = viewer_started(own_asset(viewer), "picking") if viewer else "undefined"
    own = [asset("page.js"), own_asset("app.js"), f"const view = {started};", *map(own_asset, scripts)]
    script = "\n".join(['"use strict";', *own])
    library = viewer_code()[0] if viewer else ""
    style = variables() + "".join(map(asset, STYLES)) + own_asset("app.css")
    steps = [tag("li", name, aria_current="step" if k == step else None) for k, name in enumerate(STEPS)]
    head = tag(
        "header",
        tag("div", tag("h1", title), tag("p", NOTICE, class_="notice"), class_="title"),
        tag("nav", tag("a", "All cases and runs", href="./"), aria_label="app"),
        tag("ol", *steps, class_="steps", aria_label="steps"),
    )
    footer = tag("footer", tag("p", f"Made by o3dls {__version__}, an open research tool. {NOTICE}"))
    code = [text for text in (library, script) if text]
    whole = join(tag("main", head, body), footer, *(tag("script", Html(text)) for text in code))
    return document(f"{title}: o3dls app", style, whole, code, connects=True)


def own_asset(name: str) -> str:
    """Read the text of a file that comes with the app."""
    return (files("o3dls.app") / "static" / name).read_text(encoding="utf-8")


def list_facts(facts: Mapping[str, str]) -> Html:
    """Write facts as pairs of a name and what is said of it."""
    rows = [tag("div", tag("dt", key), tag("dd", said)) for key, said in facts.items()]
    return tag("dl", *rows, class_="facts")


def list_folder(listed: Mapping[str, Sequence[str]]) -> Html:
    """List the cases and runs of the folder; two runs and more can be chosen and compared."""
    cases = []
    for path in listed[CASES]:
        link = tag("a", path, href=f"case?folder={quote(path)}")
        cases.append(tag("li", link, tag("span", class_="grade"), data_case=path))
    said = tag("p", "There is no case here yet.")
    found = [tag("h3", "Cases"), tag("ul", *cases, class_="runs")] if cases else [said]
    runs = listed[RUNS]
    if runs:
        found += [tag("h3", "Runs"), list_runs(runs, choose=len(runs) > 1)]
    cohorts = sorted({folder for one in runs if (folder := one.rpartition("/")[0])})
    links = [tag("li", tag("a", f"all of {one}", href=f"cohort?folder={quote(one)}")) for one in cohorts]
    return join(*found, *([tag("h3", "As a cohort"), tag("ul", *links)] if links else []))


def runs_of_case(files: Mapping[str, str], runs: Sequence[str]) -> Html:
    """List the runs of a case with these files; case.toml and the pose may have changed since."""
    from ..runs.folder import read_record

    own = []
    for path in runs:
        with suppress(InputError):  # a run that was damaged says so where it is opened
            known = read_record(path).case.files
            both = (files.keys() & known.keys()) - {"case.toml", INIT}
            if both and all(files[key] == known[key] for key in both):
                own.append(path)
    return list_runs(own) if own else tag("p", "There is no run of this case yet.")


def list_runs(runs: Sequence[str], *, choose: bool = False) -> Html:
    """List runs, each with room for its grade and its small picture, which come later; choose: with a box
    each, and what compares those that are chosen.
    """
    lines = []
    for path in runs:
        box = tag("input", type="checkbox", name="run", value=path, aria_label=f"compare {path}")
        link = tag("a", path, href=f"run?folder={quote(path)}")
        lines.append(tag("li", box if choose else None, link, tag("span", class_="grade"), data_run=path))
    button = tag("button", "Compare the chosen runs", type="button", id="compare") if choose else None
    said = tag("p", id="compared", role="status") if choose else None
    return join(tag("ul", *lines, class_="runs"), button, said)


def bring_form(there: Sequence[str]) -> Html:
    """Write the form that brings a prior, a map and landmarks, each from this computer or the folder."""
    options = "".join(tag("option", one, value=one) for one in there)
    slots = [
        tag(
            "fieldset",
            Html(
                own_asset("slot.html").format(
                    role=role,
                    title=escape(title),
                    words=escape(words),
                    options=options,
                    folder="" if role in FOLDERS else " hidden",
                )
            ),
            class_="slot",
            id=role,
            data_role=role,
        )
        for role, title, words in SLOTS
    ]
    return join(tag("div", *slots, class_="slots"), Html(own_asset("make.html")))


def place_section(said: str, *, placing: bool) -> Html:
    """Write how the prior is placed, with the form of pairs where these are needed."""
    names = join(*(tag("option", name, value=name) for name in PLACES))
    form = Html(own_asset("pairs.html").format(names=names)) if placing else tag("p", BY_LANDMARKS)
    return tag("section", tag("h2", "2 Place"), tag("p", said), form, id="placing")


def fuse_section(case: Path, targets: Mapping[str, Path]) -> Html:
    """Write the choice of what is run, with the folder that each writes, and what shows how far it is."""
    lines = []
    for key, out in targets.items():
        one = PRESETS[key]
        if key == OWN and not (case / one.file).is_file():
            continue
        button = tag("input", type="radio", name="preset", value=key, checked=key == "default")
        words = tag("span", f" {one.words} Writes ", tag("code", out.as_posix()), ".", class_="soft")
        lines.append(tag("p", tag("label", button, f" {one.title}"), words))
    how = tag("fieldset", tag("legend", "How"), *lines)
    writes = tag("p", WRITES, class_="soft")
    return tag("section", tag("h2", "3 Fuse"), how, writes, Html(own_asset("fuse.html")), id="fusing")
