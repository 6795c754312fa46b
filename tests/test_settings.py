"""The reason of every number stands alone: a reader of one row of `o3dls settings` knows what it is."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest
from conftest import ROOT

from o3dls.cli.settings import CLASSES, tables

LONGEST = 95  # characters that a row of a table has room for
LEANING = ("and", "or", "nor", "but", "likewise", "the same", "as which", "next to", "of", "that", "which")
BEGINS = re.compile(rf"(?:{'|'.join(LEANING)}|(?:by|in|on|from|to|with) (?:which|what))\b", re.IGNORECASE)


def reasons() -> Iterator[tuple[str, str]]:
    """Name and reason of every number of every settings class, wherever it is."""
    for path in sorted((ROOT / "o3dls").rglob("*.py")):
        for kind in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(kind, ast.ClassDef):
                for one in kind.body:
                    if isinstance(one, ast.AnnAssign) and _called(one.value) == "number":
                        assert isinstance(one.target, ast.Name)
                        assert isinstance(one.value, ast.Call)
                        yield f"{kind.name}.{one.target.id}", ast.literal_eval(one.value.args[2])


def _called(node: ast.expr | None) -> str | None:
    return node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else None


REASONS = dict(reasons())


def fault(why: str) -> str | None:
    """What keeps a reason from standing alone, if anything does."""
    if not why.strip():
        return "it is empty"
    if why.rstrip()[-1] in ",;:":
        return "it ends before the sentence does"
    if BEGINS.match(why.strip()):
        return "it leans on the row above"
    return None if len(why) <= LONGEST else "it is too long"


def test_every_number_is_found() -> None:
    assert len(REASONS) > 250
    assert {"Weights.data", "ContactSettings.depth", "TopologySettings.evidence"} <= set(REASONS)


@pytest.mark.parametrize(
    "why",
    [
        "",
        " ",
        "or so near",
        "and by several percent",
        "Likewise",
        "the same where that is asked",
        "this far,",
    ],
)
def test_a_reason_that_leans_on_another_is_refused(why: str) -> None:
    assert fault(why)


@pytest.mark.parametrize(
    "why", ["order of the splines", "nodes per radius", "theory has it", "otherwise no wall is left"]
)
def test_a_reason_is_not_refused_for_a_word_that_only_looks_alike(why: str) -> None:
    assert fault(why) is None


def test_every_class_of_numbers_is_printed() -> None:
    printed = "\n".join(map(tables, CLASSES))
    kinds = {name.partition(".")[0] for name, _ in reasons()}
    # the weights of the paper's energy are parameters of its stage, and printed with those
    assert {kind for kind in kinds if f"`{kind}`" not in printed} == {"Weights"}


def test_every_reason_stands_alone() -> None:
    assert {name: why for name, why in REASONS.items() if fault(why)} == {}
