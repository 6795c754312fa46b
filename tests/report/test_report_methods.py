"""The paragraph of methods says what run.json says, and the BibTeX entries can be read."""

from __future__ import annotations

import html
import json
import re
from pathlib import Path

import pytest

from o3dls.pipeline.pipeline import Pipeline
from o3dls.report.page import report_page
from o3dls.report.sections.methods import bibtex, paragraph
from o3dls.report.subject import read_subject
from o3dls.stages.landmarks import Landmarks
from tests.finished import bulged_case, finished
from tests.tiny import Nudge


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("methods") / "run"
    return Pipeline([Landmarks(), Nudge(share=0.25)], folds=3).run(bulged_case()).write(folder)


def test_the_paragraph_names_what_was_done_with_parameters_and_versions(run: Path) -> None:
    record = json.loads((run / "run.json").read_text())
    text = paragraph(read_subject([run]), record)
    assert "80 of type eam" in text
    assert "(1) a rigid motion from named landmarks (scale = no)." in text
    assert "(2) stage nudge" in text
    assert "share = 0.25" in text
    assert "cross-validated in 3 folds" in text
    for name, version in record["versions"].items():
        assert version is None or f"{name} {version}" in text
    record["pipeline"] |= {"folds": 0, "stage": [{"use": "level_set", "as": None, "spacing": 1.0}]}
    other = paragraph(read_subject([run]), record)
    assert "(1) a level set on a 1 mm grid (spacing = 1)." in other
    assert "cross-validated" not in other


def test_the_bibtex_entries_are_whole(run: Path) -> None:
    record = json.loads((run / "run.json").read_text())
    text = bibtex(record, "2031-05-06")
    assert re.findall(r"^@(\w+){(\w+),$", text, re.MULTILINE) == [
        ("software", "o3dls"),
        ("article", "open3d"),
    ]
    assert text.count("{") == text.count("}")
    assert "year = {2031}" in text
    assert f"version = {{{record['versions']['o3dls']}}}" in text


def test_both_stand_in_the_page_with_a_button_that_copies_them(tmp_path: Path) -> None:
    subject = read_subject([finished(tmp_path / "run")])
    page = report_page(subject)
    for identifier, text in (
        ("methods-text", paragraph(subject, subject.records[0])),
        ("methods-bibtex", bibtex(subject.records[0], subject.date)),
    ):
        assert f'data-copy="{identifier}"' in page
        shown = re.findall(rf'<pre id="{identifier}" tabindex="0"><code>(.*?)</code>', page, re.DOTALL)
        assert [html.unescape(one) for one in shown] == [text]
