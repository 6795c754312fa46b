"""The first sentence of a class's docstring is a sentence: it has a verb, in its main clause."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest
from conftest import ROOT

CLAUSES = re.compile(r"[:;]|\.\s|\.$| that | which | where | who ")  # what follows is no main clause
VERB = re.compile(  # as these docstrings use them; whoever writes another one adds it
    r"\b(is|are|was|were|has|have|holds?|may|shall|can|cannot|met|depends|grows|says?|gives|lists|shows?|names"
    r"|records|describes?|explains|compares|finds|takes|keeps|reads|runs?|makes?|turns|chooses?|estimates|hands"
    r"|delivers|imported|listens|replays|watches|answers|applies|leads|lies?|ends|shifts|stands?|bound|scale"
    r"|govern|discretise|comes|solves)\b"
)
ORDER = re.compile(r"(Align|Find|Fit|Minimise|Move|Place|Remove|Search|Turn|Write) ")  # stages and writers
QUESTION = re.compile(r"(How|What|When|Where|Which|Who) ")


def has_verb(docstring: str) -> bool:
    clause = CLAUSES.split(" ".join(docstring.split()))[0]
    return bool(ORDER.match(clause) or (VERB.search(clause) and not QUESTION.match(clause)))


def docstrings() -> Iterator[tuple[str, str]]:
    for path in sorted((ROOT / "o3dls").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            text = ast.get_docstring(node) if isinstance(node, ast.ClassDef) else None
            if isinstance(node, ast.ClassDef) and text:
                yield f"{path.relative_to(ROOT)}: {node.name}", text


def test_a_class_is_introduced_by_a_sentence() -> None:
    found = dict(docstrings())
    assert len(found) > 200
    assert not [where for where, text in found.items() if not has_verb(text)]


@pytest.mark.parametrize(
    ("docstring", "sentence"),
    [
        ("A surface with normals at its vertices, and the distances of points.", False),
        ("How phi is kept whole on a lattice.", False),
        ("What stays fixed: the points are as the motion left them.", False),
        ("A part of the wall that is farther than 10 mm from every point.", False),
        ("A wall has normals at its vertices.", True),
        ("Move the prior onto the points.", True),
    ],
)
def test_a_phrase_is_told_from_a_sentence_by_its_main_clause(docstring: str, sentence: bool) -> None:
    assert has_verb(docstring) == sentence
