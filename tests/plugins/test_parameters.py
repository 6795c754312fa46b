"""Plugins: parameters that explain and check themselves, names that belong to one plugin only."""

from __future__ import annotations

import json
import re
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
import pytest
from conftest import ROOT
from pydantic import Field, field_validator, model_validator

from o3dls.errors import PipelineError
from o3dls.plugins import catalogue
from o3dls.plugins import plugin as stage
from o3dls.plugins.parameters import describe
from o3dls.plugins.plugin import Plugin, load, registered


class Sample(Plugin):
    """A plugin with one parameter of each kind."""

    name: ClassVar[str] = "sample"
    length: float = Field(1.5, ge=0.0, description="a length", json_schema_extra={"unit": "mm"})
    share: float | None = Field(None, gt=0.0, lt=1.0, description="a share", json_schema_extra={"unit": "1"})
    count: int = Field(3, ge=1, le=9, description="a count")
    word: Literal["one", "two"] = Field("one", description="a word")
    words: tuple[Literal["red", "blue"], ...] = Field((), description="some words")
    flag: bool = Field(True, description="a switch")
    sizes: tuple[Annotated[float, Field(gt=0.0)], ...] = Field(
        (1.0,), min_length=1, description="some lengths", json_schema_extra={"unit": "mm"}
    )
    few: tuple[str, ...] = Field((), max_length=2, description="some names")
    named: dict[str, float] = Field({}, description="a number for each name")
    plain: float = Field(0.0, description="a number without limits")

    @field_validator("length")
    @classmethod
    def _not_thirteen(cls, value: float) -> float:
        if value == 13.0:
            raise ValueError("is unlucky")
        return value

    @model_validator(mode="after")
    def _together(self) -> Sample:
        if self.share and not self.flag:
            raise ValueError("share needs flag = true")
        return self


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"length": -1.0}, "sample.length = -1.0 mm: must be a number within [0, inf) mm"),
        ({"length": float("inf")}, "sample.length = inf mm: must be a number within [0, inf) mm"),
        ({"length": 13.0}, "sample.length = 13.0 mm: is unlucky"),
        ({"share": 1.0}, "sample.share = 1.0: must be a number within (0, 1)"),
        ({"count": 2.5}, "sample.count = 2.5: must be a whole number within [1, 9]"),
        ({"word": "tow"}, "sample.word = 'tow': did you mean 'two'?"),
        ({"word": 2}, "sample.word = 2: must be one of one, two"),
        ({"words": ["red", 2]}, "sample.words[1] = 2: must be 'red' or 'blue'"),
        ({"sizes": [1.0, -1.0]}, "sample.sizes[1] = -1.0 mm: must be greater than 0"),
        ({"sizes": [None]}, "sample.sizes[0] = None mm: must be a valid number"),
        ({"words": ["red", "bleu"]}, "sample.words[1] = 'bleu': did you mean 'blue'?"),
        ({"flag": "perhaps"}, "sample.flag = 'perhaps': must be true or false"),
        ({"flag": "no"}, "sample.flag = 'no': must be true or false"),
        ({"flag": 1}, "sample.flag = 1: must be true or false"),
        ({"count": "3"}, "sample.count = '3': must be a whole number within [1, 9]"),
        ({"length": "2"}, "sample.length = '2' mm: must be a number within [0, inf) mm"),
        ({"length": True}, "sample.length = true: must be a number within [0, inf) mm"),
        ({"sizes": ["1"]}, "sample.sizes = ['1'] mm: must be a list of numbers, at least 1"),
        ({"sizes": []}, "sample.sizes = [] mm: must be a list of numbers, at least 1"),
        ({"few": ["a", "b", "c"]}, "sample.few = ['a', 'b', 'c']: must be a list of texts, at most 2"),
        ({"named": {"a": "1"}}, "sample.named = {'a': '1'}: must be a number per name"),
        ({"plain": "1"}, "sample.plain = '1': must be a number"),
        ({"lenght": 1.0}, "sample.lenght: no such parameter: did you mean 'length'?"),
        ({"share": 0.5, "flag": False}, "sample: share needs flag = true"),
    ],
)
def test_a_mistake_is_said_in_one_sentence(given: dict[str, object], sentence: str) -> None:
    with pytest.raises(PipelineError) as error:
        Sample(**given)  # type: ignore[arg-type]
    assert error.value.args == (sentence,)


def test_lists_and_numbers_of_numpy_are_taken() -> None:
    made = Sample(length=np.float32(2.0), count=np.int64(3), share=np.array(0.5))  # type: ignore[arg-type]
    assert (made.length, made.count, made.share) == (2.0, 3, 0.5)
    assert Sample(sizes=[1, 2]) == Sample(sizes=(1.0, 2.0))  # type: ignore[arg-type]


def test_plugins_of_others_have_parameters_of_any_type() -> None:
    class Other(Plugin):
        name: ClassVar[str] = "other"
        files: tuple[Path, ...] = ()
        lengths: list[float] = Field([1.0])
        words: set[str] = Field(set())
        boxes: dict[str, tuple[float, float]] = Field({})

    made = Other(files=["a/b"], lengths=[2.0], words=["x"], boxes={"c": [1.0, 2.0]})  # type: ignore[arg-type]
    assert (made.files, made.lengths, made.words, made.boxes) == (
        (Path("a/b"),),
        [2.0],
        {"x"},
        {"c": (1.0, 2.0)},
    )
    record = json.loads(json.dumps(made.record()))
    assert Other(**{key: value for key, value in record.items() if key != "use"}) == made


def test_several_mistakes_are_several_sentences() -> None:
    with pytest.raises(PipelineError) as error:
        Sample(length=-1.0, count=99)
    assert len(error.value.args) == 2


def test_parameters_describe_themselves() -> None:
    shown = {p.name: (p.kind, p.default, p.unit, p.limits) for p in describe(Sample)}
    assert shown == {
        "length": ("number", 1.5, "mm", "[0, inf)"),
        "share": ("number", None, "", "(0, 1)"),
        "count": ("whole number", 3, "", "[1, 9]"),
        "word": ("word", "one", "", "one, two"),
        "words": ("list of words", (), "", "red, blue"),
        "flag": ("true or false", True, "", ""),
        "sizes": ("list of numbers, at least 1", (1.0,), "mm", ""),
        "few": ("list of texts, at most 2", (), "", ""),
        "named": ("number per name", {}, "", ""),
        "plain": ("number", 0.0, "", ""),
    }


def test_two_plugins_of_one_name_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    twice = [EntryPoint("icp", module, "o3dls.stages") for module in ("a:A", "b:B")]
    monkeypatch.setattr(stage, "entry_points", lambda group: twice)
    with pytest.raises(PipelineError, match=r"two plugins are named 'icp' in o3dls.stages: a:A and b:B"):
        registered.__wrapped__("o3dls.stages")


def test_a_plugin_that_cannot_be_imported_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        stage, "registered", lambda group: {"ghost": EntryPoint("ghost", "no_such_module:Ghost", group)}
    )
    with pytest.raises(PipelineError, match="stage 'ghost' cannot be loaded from no_such_module:Ghost"):
        load("stage", "ghost")


@pytest.mark.parametrize(("kind", "group"), [("stage", "o3dls.stages"), ("write", "o3dls.writers")])
def test_every_plugin_of_ours_is_whole(kind: str, group: str) -> None:
    """Named as it is registered; each parameter says what it means; the record gives it back; it has a
    sheet.
    """
    for name in registered(group):
        plugin = load(kind, name)
        assert plugin.name == name
        assert plugin() == plugin.model_validate({k: v for k, v in plugin().record().items() if k != "use"})
        for parameter in describe(plugin):
            assert parameter.meaning, f"{name}.{parameter.name} says not what it means"
        assert re.search(rf"^{name}: .", catalogue.sheet(name))


@pytest.mark.parametrize("name", ["deform", "topology", "level_set"])
def test_the_documentation_has_every_parameter(name: str) -> None:
    """Where it has not: the table that is wanted is in the message."""
    own = [p for p in describe(load("stage", name)) if p.name not in ("as", "after")]
    values = [f"`{catalogue.as_toml(p.default)}` {p.unit}".strip() for p in own]
    rows = [
        f"| `{p.name}` | {value} | {p.limits or p.kind} | {p.meaning} |"
        for p, value in zip(own, values, strict=True)
    ]
    wanted = "\n".join([f"| `{name}` | default | bounds | meaning |", "|---|---|---|---|", *rows])
    assert wanted in (ROOT / "docs" / "method.md").read_text(encoding="utf-8"), wanted
