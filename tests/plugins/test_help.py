"""What `help` shows of a stage: its words and its parameters with their units, and nothing of pydantic's."""

from __future__ import annotations

import inspect
import pydoc
import re
from typing import ClassVar

import pytest
from pydantic import BaseModel, Field

import o3dls
from o3dls import ICP, Deform, Export, Phases, Report, Stage
from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.plugins.catalogue import sheet
from o3dls.plugins.help import words
from o3dls.plugins.parameters import describe

PLUGINS = [one for name in o3dls.PUBLIC if hasattr(one := getattr(o3dls, name), "model_fields")]
OF_PYDANTIC = {name for name in dir(BaseModel) if not name.startswith("__")}


class Sample(Stage):
    """Do nothing, in two lines
    of words.
    """

    name: ClassVar[str] = "sample"
    length: float = Field(default=1.5, ge=0.0, description="a length", json_schema_extra={"unit": "mm"})
    must: int = Field(description="without a default")

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        """Give the start back."""
        return start


def shown(thing: object) -> str:
    return pydoc.plain(pydoc.render_doc(thing))


@pytest.mark.parametrize("plugin", PLUGINS, ids=lambda one: one.__name__)
def test_help_shows_nothing_of_pydantic(plugin: type[Stage]) -> None:
    text = shown(plugin)
    assert len(PLUGINS) > 10
    assert not OF_PYDANTIC & set(re.findall(r"^ \|  (\w+)", text, re.MULTILINE))
    assert not [
        word for word in ("model_", "__pydantic", "Annotated", "Metadata", "annotated_types") if word in text
    ]
    assert not OF_PYDANTIC & set(dir(plugin))


@pytest.mark.parametrize("plugin", [ICP, Deform, Export, Report], ids=lambda one: one.__name__)
def test_help_shows_every_parameter_with_unit_and_meaning(plugin: type[Stage]) -> None:
    text = " ".join(shown(plugin).replace("|", " ").split())
    for p in describe(plugin):
        name = "as_" if p.name == "as" else p.name
        block = text.partition(f" {name} : ")[2]
        assert p.unit in block.partition(", default")[0]
        assert p.meaning in block
        assert f", default {p.default!r} {p.meaning}" in block


def test_a_block_has_type_bounds_unit_and_default() -> None:
    assert "length : number within [0, inf) mm, default 1.5\n    a length\n" in str(Sample.__doc__)
    assert str(Sample.__doc__).endswith("must : whole number\n    without a default")
    assert "reject : list of words, default ()\n    rules that reject pairs" in str(ICP.__doc__)
    assert "deform : Deform, default Deform()\n" in str(Phases.__doc__)
    lengths = "list of numbers, at least 1, at most 10, rms radii, default (1.15, 0.46)"
    assert f"vector : {lengths}\n" in str(Deform.__doc__)


def test_the_signature_has_plain_types_and_that_of_a_stage_is_its_call() -> None:
    given = inspect.signature(Sample).parameters
    assert list(given) == ["as_", "after", "length", "must"]
    assert (given["length"].annotation, given["length"].default) == (float, 1.5)
    assert given["must"].default is inspect.Parameter.empty
    assert list(inspect.signature(Sample(must=1)).parameters) == ["case", "start"]


def test_own_words_stay_without_the_parameters() -> None:
    assert words(Sample) == "Do nothing, in two lines\nof words."
    assert str(Sample.__doc__).startswith(words(Sample) + "\n\nParameters\n")
    assert "Parameters\n---" not in sheet("icp")
    assert Stage.__doc__ == words(Stage)  # which no pipeline names


def test_dir_of_a_stage_lists_what_its_authors_wrote() -> None:
    assert {"__call__", "aligned", "name", "record", "obstacle"} <= set(dir(ICP))
