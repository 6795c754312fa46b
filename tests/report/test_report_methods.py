"""The paragraph of methods says what run.json says, and the BibTeX entries can be read."""

from __future__ import annotations

import html
import re
import tomllib
from datetime import date
from pathlib import Path

import pytest
from conftest import ROOT

from o3dls import __version__
from o3dls.pipeline.pipeline import Pipeline
from o3dls.report.page import report_page
from o3dls.report.sections.methods import AUTHORS, RELEASED, bibtex, paragraph
from o3dls.report.subject import read_subject
from o3dls.runs.folder import read_record
from o3dls.stages.landmarks import Landmarks
from tests.finished import bulged_case, finished
from tests.tiny import Nudge


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("methods") / "run"
    return Pipeline([Landmarks(), Nudge(share=0.25)], folds=3).run(bulged_case()).write(folder)


def test_the_paragraph_names_what_was_done_with_parameters_and_versions(run: Path) -> None:
    made = read_record(run)
    text = paragraph(read_subject([run]), made)
    assert "80 of type eam" in text
    assert "(1) a rigid motion from named landmarks (scale = no)." in text
    assert "(2) stage nudge" in text
    assert "share = 0.25" in text
    assert "cross-validated in 3 folds" in text
    for name, version in made.versions.items():
        assert version is None or f"{name} {version}" in text
    pipeline = {"folds": 0, "stage": [{"use": "level_set", "as": None, "spacing": 1.0}]}
    other = paragraph(read_subject([run]), made.model_copy(update={"pipeline": pipeline}))
    assert "(1) a level set on a 1 mm grid (spacing = 1)." in other
    assert "cross-validated" not in other


def test_the_bibtex_entries_are_whole(run: Path) -> None:
    made = read_record(run)
    text = bibtex(made.versions["o3dls"])
    assert re.findall(r"^@(\w+){(\w+),$", text, re.MULTILINE) == [
        ("software", "o3dls"),
        ("article", "open3d"),
    ]
    assert text.count("{") == text.count("}")
    assert f"version = {{{made.versions['o3dls']}}}" in text


def test_both_stand_in_the_page_with_a_button_that_copies_them(tmp_path: Path) -> None:
    subject = read_subject([finished(tmp_path / "run")])
    page = report_page(subject)
    for identifier, text in (
        ("methods-text", paragraph(subject, subject.last.run.provenance)),
        ("methods-bibtex", bibtex(subject.last.run.provenance.versions["o3dls"])),
    ):
        assert f'data-copy="{identifier}"' in page
        shown = re.findall(rf'<pre id="{identifier}" tabindex="0"><code>(.*?)</code>', page, re.DOTALL)
        assert [html.unescape(one) for one in shown] == [text]
    assert f"<footer><p>Made by o3dls {__version__} ({AUTHORS}, {RELEASED[:4]})" in page


def test_the_citation_file_and_the_bibtex_agree() -> None:
    """A file of scalars and of lists of them needs no reader of YAML: top keys, quoted or not."""
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    cff = {key: value.strip('"') for key, value in re.findall(r"^([\w-]+): *(.*)$", text, re.MULTILINE)}
    required = {"cff-version", "message", "title", "authors"}  # by the schema 1.2.0
    assert required | {"type", "version", "license", "date-released"} <= cff.keys()
    assert (cff["cff-version"], cff["type"]) == ("1.2.0", "software")
    assert date.fromisoformat(cff["date-released"])
    assert cff["version"] == __version__
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert cff["license"] == project["license"]
    assert "doi" not in text.lower()
    names = re.findall(r'^  - name: "(.*)"$', text.partition("authors:")[2], re.MULTILINE)
    entry = bibtex(__version__)
    for line in (
        f"author = {{{{{' and '.join(names)}}}}}",
        f"title = {{{cff['title']}}}",
        f"version = {{{cff['version']}}}",
        f"year = {{{cff['date-released'][:4]}}}",
    ):
        assert line in entry


def test_the_readme_says_how_to_cite() -> None:
    assert "CITATION.cff" in (ROOT / "README.md").read_text(encoding="utf-8")
