"""What users read is in the field's terms: a list of words that stand in no page and in no message."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import ROOT

from o3dls import ICP, Landmarks, Pipeline, default_pipeline
from o3dls.report.writer import compare, write_report
from tests.finished import finished
from tests.tiny import ball_case

# ours, and what the field says
BANNED = {
    r"shreds?": "components",
    r"lattices?": "grid",
    r"carr(?:y|ies|ied|ying)": "interpolated, transferred",
    r"loosening": "coarse-to-fine factor",
    r"say there": "no points here: shape from the image alone",
    r"nothing to add": "the points ask for no other wall",
    r"hold no field": "the residuals are consistent with noise",
    r"mend(?:s|ed|ing)?": "fix, repair",
    r"overrul\w+": "override",
    r"the fit saw|seen by the fit": "used in the fit",
    r"worth mention": "a number",
    r"speaks? first": "headline",
    r"moved partner": "partner on the moved prior",
    r"follows the noise": "overfits the noise",
}
WORDS = re.compile(rf"\b(?:{'|'.join(BANNED)})\b", re.IGNORECASE)
COMMENT = re.compile(r"^\s*//.*$|/\*[\s\S]*?\*/", re.MULTILINE)  # of scripts and styles
SPOKEN = ("report", "paper", "cli", "stages")  # packages whose texts users read


def literals(path: Path) -> Iterator[str]:
    """Texts in a module that are no docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef
    first = [node.body[0] for node in ast.walk(tree) if isinstance(node, kinds) and node.body]
    docs = {id(one.value) for one in first if isinstance(one, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
            yield node.value


def found(text: str) -> list[str]:
    return [match[0] for match in WORDS.finditer(text)]


@pytest.mark.parametrize("package", SPOKEN)
def test_texts_of_the_code_have_none_of_the_words(package: str) -> None:
    for path in (ROOT / "o3dls" / package).rglob("*.py"):
        for text in literals(path):
            # a key of a record, such as a column of a trace, is not text: it has no space
            assert " " not in text or not found(text), (path.name, text)


def test_nor_have_the_parts_of_the_page_and_what_is_written_on_it() -> None:
    others = [ROOT / "docs/report.md", ROOT / "o3dls/run_warning.py"]
    for path in (*(ROOT / "o3dls/report/static").iterdir(), *others):
        shown = COMMENT.sub("", path.read_text(encoding="utf-8"))
        assert not found(shown), path.name


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """A report of stages as they are, one of a run with all that there may be, and a cohort's page."""
    folder = tmp_path_factory.mktemp("words")
    real = Pipeline([Landmarks(), ICP()], folds=0).run(ball_case(points=60)).write(folder / "real")
    runs = [real, finished(folder / "all")]
    written = [write_report([run]) for run in runs]
    written.append(compare(runs, folder / "cohort.html"))
    return {path.parent.name + path.name: path.read_text(encoding="utf-8") for path in written}


def test_the_pages_have_none_of_the_words(pages: dict[str, str]) -> None:
    assert len(pages) == 3
    for name, page in pages.items():
        shown = re.sub(r"<(script|style)\b.*?</\1>|data:image[^\"]*", "", page, flags=re.DOTALL)
        assert not found(shown), name


def test_the_terms_of_the_field_are_there(pages: dict[str, str]) -> None:
    page = "".join(pages.values())
    for words in (
        "Fused surface",
        "before registration",
        "no points here: shape from the image alone",
        "Pose uncertainty",
        "Is the uncertainty reliable?",
        "Share of outliers",
        "handles (0 = none)",
        "Distribution of distances",
        "translation, mm",
        "rotation, degrees",
    ):
        assert words in page, words


def test_a_stage_that_the_case_does_not_allow_is_skipped_with_the_reason(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level("INFO", logger="o3dls")
    default_pipeline().allowed_by(replace(ball_case(points=40), prior_landmarks={}))
    assert "Skipping 'landmarks': no landmark pairs: at least 3 are needed in 3D" in caplog.text
