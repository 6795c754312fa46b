"""The page, HTML and Markdown, from a results folder alone."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from ..io.atomic import write_file
from ..report.document import document
from ..report.markup import tag
from . import atrium, formulation, noise, real, related, temporal
from .blocks import Block, Command, Figure, Heading, Text
from .claims import claims, wrong_poses
from .results import Results

EXPERIMENTS = (noise, atrium, real, formulation, related, temporal)
TITLE = "o3dls: the paper's experiments"
STYLE = """body{font:16px/1.5 system-ui,sans-serif;max-width:62rem;margin:2rem auto;padding:0 1rem;
color:#16191d;background:#fff}
table{border-collapse:collapse;font-size:.9rem}td,th{padding:.2rem .6rem;
border-bottom:1px solid #d5d9df;text-align:right}
th:first-child{text-align:left}.scroll{overflow-x:auto}figure{margin:1.5rem 0}img{max-width:100%}
figcaption,.soft{color:#4a5260;font-size:.9rem}
pre{background:#f2f4f6;padding:.6rem;overflow-x:auto}code{overflow-wrap:anywhere}
@media (max-width:600px){body{margin:1rem auto}h1{font-size:1.4rem}h2{font-size:1.15rem}
table{font-size:.8rem}td,th{padding:.15rem .35rem}th[scope="row"]{font-weight:400}
img{max-width:46rem}} /* small letters of a picture must stay legible: it scrolls by itself */"""


def write_page(results: Results, folder: Path) -> Path:
    """Write index.html, index.md and figures/ into a folder, and return the path of the HTML page."""
    blocks = list(page(results))
    (folder / "figures").mkdir(exist_ok=True)
    for block in blocks:
        if isinstance(block, Figure):
            write_file(folder / block.file, block.png)
    texts = {
        "index.md": "\n\n".join(block.markdown() for block in blocks) + "\n",
        "index.html": document(TITLE, STYLE, tag("main", *(block.html() for block in blocks))),
    }
    for name, text in texts.items():
        write_file(folder / name, text)
    return folder / "index.html"


def page(results: Results) -> list[Block]:
    """Make all blocks, the figures first; a section without numbers says why it is empty."""
    amount = "a quick look: few seeds, few levels" if results.quick else "all seeds"
    sections = [*claims(results), *wrong_poses(results)]
    for experiment in EXPERIMENTS:
        sections += experiment.blocks(results)
    return [
        Heading("The paper's experiments, and what it left open", 1),
        Text(
            f"Made from paper_results.json beside this page ({amount}). Research software, not for "
            "clinical use."
        ),
        Heading("Figures"),
        *_figures_of(sections),
        *(block for block in sections if not isinstance(block, Figure)),
        Heading("Make this page"),
        Command(f"o3dls paper --out DIR{' --quick' if results.quick else ''}"),
    ]


def _figures_of(blocks: Iterable[Block]) -> list[Figure]:
    """List the figures, each with the heading that stands before it."""
    found = list[Figure]()
    heading = None
    for block in blocks:
        heading = block if isinstance(block, Heading) else heading
        if isinstance(block, Figure):
            found.append(replace(block, section=heading))
    return found
