"""The pages of the app: what there is and how files are brought; a case with its steps; a run with its
exports. A page is written whole by the server, with the style, the policy and the viewer of the report.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from ..errors import InputError
from ..report.markup import Html, data_block, join, tag
from ..report.page_parts import asset
from .live_session import live_section
from .mends import list_warnings
from .parts import (
    bring_form,
    framed,
    fuse_section,
    list_facts,
    list_folder,
    place_section,
    runs_of_case,
)
from .pose import FEWEST_PAIRS
from .shelf import FILES
from .take import commands, exports
from .worker import Tell

OWN_FILES = ("case.toml", "points.csv")  # of a case folder, by which its runs know it


def home_page(folder: Path, listed: Mapping[str, Sequence[str]]) -> str:
    """Write the first page: what there is in the folder, and the form by which files are brought."""
    where = tag("p", "Everything stays in the folder ", tag("code", str(folder)), " on this machine.")
    there = tag("section", tag("h2", "Cases and runs"), list_folder(listed), id="there")
    bring = tag("section", tag("h2", "1 Bring a prior and a map"), bring_form(listed[FILES]), id="bring")
    return framed("o3dls app", join(where, there, bring), ("lists.js", "doubt.js", "folders.js", "bring.js"))


def case_page(case: Path, runs: Sequence[str], targets: Mapping[str, Path], tell: Tell) -> str:
    """Write the page of a case: prior and points in one picture, and the steps from there to a run.

    targets: the folder that a run would write, by preset.
    """
    from ..io.case_reader import read_case
    from .place import drawn, start_of

    found = read_case(case)
    start, beside, said = start_of(found)
    names, _, _ = found.landmark_pairs()
    data = data_block("scene", drawn(found, start, beside))
    picture = tag("section", tag("h2", "Prior and map"), Html(asset("viewer.html")), data, id="pictures")
    steps = tag(
        "div",
        place_section(said, placing=len(names) < FEWEST_PAIRS),
        fuse_section(case, targets),
        live_section(),
        tag("section", tag("h2", "4 Judge"), runs_of_case(found.files, runs), id="judge"),
        class_="side",
    )
    kinds = dict.fromkeys(found.points.type.tolist())
    facts = {
        "Points": ", ".join(f"{int((found.points.type == kind).sum())} {kind}" for kind in kinds),
        "Prior": f"{len(found.prior.faces)} triangles, {found.prior.volume / 1000:.1f} ml",
        "Frame of the map": found.frame,
        "Landmark pairs": ", ".join(names) or "none",
    }
    poses = {"T": start.T_map_prior.tolist(), "beside": beside.T_map_prior.tolist()}
    state = data_block("app", {"case": case.as_posix(), **poses})
    body = join(list_facts(facts), tag("div", picture, steps, class_="session"), _made_lines(), state)
    return framed(
        found.name,
        body,
        ("lists.js", "pairs.js", "place.js", "fuse.js", "live.js", "made.js"),
        step=1,
        viewer="picking.js",
    )


def run_page(run: Path, cases: Sequence[str], tell: Tell) -> str:
    """Write the page of a run: its grade, its doubts with what mends them, the report, and what it is taken
    away as.
    """
    from ..report.checks import checks
    from ..report.grading.check import WORDS, doubtful, worst_grade
    from ..report.sections.provenance import as_toml
    from ..report.subject import read_subject
    from ..run_warning import each_once
    from ..runs.folder import read_record

    subject = read_subject([run])
    found = checks(subject)
    grade = worst_grade(found)
    untold = [one for one in found if one.grade == "none"]
    what = f": {subject.last.name} of case {subject.case.name}"
    record = read_record(run)
    case = _case_of(record.case.files, cases)
    judged = tag(
        "section",
        tag("h2", "4 Judge"),
        tag("p", tag("strong", WORDS[grade]), what, class_=f"overall {grade}"),
        tag("ul", *(tag("li", f"{one.name}: {one.said}") for one in doubtful(found))),
        tag("ul", *(tag("li", f"no data for {one.name}: {one.said}") for one in untold), class_="untold"),
        list_warnings(each_once(subject.last.estimate.warnings), case),
        tag("p", tag("a", "Open the report", href=f"{quote(run.as_posix())}/report.html")),
        tag("p", tag("a", f"Back to {case}", href=f"case?folder={quote(case)}")) if case else None,
        id="judge",
    )
    taken = _take_section(run, as_toml(record.pipeline))
    body = join(judged, taken, data_block("app", {"run": run.as_posix()}))
    return framed(run.name, body, ("take.js",), step=3)


def compare_page(runs: Sequence[Path], tell: Tell) -> str:
    """Write the page that `o3dls compare` writes on runs."""
    from ..report.cohort.entries import read_entries
    from ..report.cohort.page import cohort_page

    return cohort_page(read_entries(runs), Path("compare.html"))


def cohort_of(folder: Path, tell: Tell) -> str:
    """Write the page that `o3dls cohort` writes on the runs in a folder, and on cases that failed."""
    from ..pipeline.outcome import gathered
    from ..report.cohort.page import cohort_page
    from ..report.writer import cohort_entries

    if folder.is_dir() and any(one.is_symlink() for one in folder.iterdir()):
        raise InputError(f"{folder}: holds links, which the app does not follow")
    outcomes = gathered(folder)
    failed = {one.case: one.error for one in outcomes if one.error}
    return cohort_page(cohort_entries(outcomes, folder), Path("cohort.html"), failed)


def _case_of(files: Mapping[str, str], cases: Sequence[str]) -> str | None:
    """Return the case folder whose own files are those of a run; None where it is not there, or changed."""
    from hashlib import sha256

    from ..io.text import read_bytes

    for case in cases:
        own = {path.name: path for name in OWN_FILES if (path := Path(case) / name).is_file()}
        if own and all(files.get(name) == sha256(read_bytes(path)).hexdigest() for name, path in own.items()):
            return case
    return None


def _take_section(run: Path, pipeline: str) -> Html:
    """Write the exports of a run, each with what it is for; and the commands and the pipeline of the same."""
    lines = [
        tag(
            "li",
            tag("button", f"Export {name}", type="button", data_export=name),
            f" {words} ",
            tag("span", role="status"),
        )
        for name, words in exports().items()
    ]
    text = "\n".join(commands(run))
    return tag(
        "section",
        tag("h2", "5 Take away"),
        tag("ul", *lines, class_="exports"),
        tag("h3", "The same in a terminal, in the folder of the app"),
        tag("pre", text, id="commands", tabindex="0", role="group", aria_label="commands"),
        tag("button", "Copy", type="button", data_copy="commands"),
        tag("h3", "The pipeline file that makes the same run, with every parameter"),
        tag("pre", pipeline, id="pipeline", tabindex="0", role="group", aria_label="pipeline file"),
        tag("button", "Copy", type="button", data_copy="pipeline", aria_label="Copy the pipeline file"),
        id="take",
    )


def _made_lines() -> Html:
    """Write room for what was said when this page's case was made."""
    said = tag("pre", id="made-command", tabindex="0", role="group", aria_label="the command")
    more = tag("ul", id="made-said")
    summary = tag("summary", "How this case was made")
    return tag("details", summary, said, more, id="made", hidden=True)
