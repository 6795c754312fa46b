"""The JSON schema of pipeline files accepts what the reader accepts and names what it refuses."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from typing import Any

import pytest
from conftest import ROOT

from o3dls.errors import PipelineError
from o3dls.pipeline.file import pipeline_from
from o3dls.pipeline.schema import schema
from o3dls.plugins.plugin import GROUPS, load, registered

WRONG = {
    "an unknown key": 'cases = "a"',
    "one fold": "folds = 1",
    "a number for a yes": "keep_last = 1",
    "folds as a text": 'folds = "5"',
    "an unknown stage": '[[stage]]\nuse = "icpp"',
    "a stage without a name": "[[stage]]\nkeep = 0.9",
    "an unknown parameter": '[[stage]]\nuse = "icp"\nkeeep = 0.9',
    "a number out of its bounds": '[[stage]]\nuse = "icp"\nreject = "trimmed"\nkeep = 1.5',
    "a yes for a number": '[[stage]]\nuse = "level_set"\nspacing = true',
    "an unknown word": '[[stage]]\nuse = "icp"\npreset = "standart"',
    "an unknown word in a list": '[[stage]]\nuse = "icp"\nreject = ["trimed"]',
    "a name that only Python needs": '[[stage]]\nuse = "icp"\nas_ = "a"',
    "a part that is placed": '[[stage]]\nuse = "phases"\n[stage.deform]\nafter = "icp"',
    "a mistake in a part": '[[stage]]\nuse = "phases"\n[stage.deform]\nvector = []',
    "a writer as a stage": '[[stage]]\nuse = "report"',
    "one table for a list": '[stage]\nuse = "icp"',
    "too many to compare": '[[write]]\nuse = "report"\ncompare = ["a", "b", "c", "d", "e"]',
}
RIGHT = {
    "nothing": "",
    "one rule as a text": '[[stage]]\nuse = "icp"\nreject = "trimmed"\nkeep = 0.8',
    "rules as a list": '[[stage]]\nuse = "icp"\nreject = ["trimmed", "mad"]',
    "a whole number for a number": '[[stage]]\nuse = "level_set"\nspacing = 2',
    "a part": '[[stage]]\nuse = "phases"\npose_sd = 1.0\n[stage.deform]\nodds = 2.0',
    "no folds": "folds = 0",
    "the last estimate kept": "keep_last = true",
}


@pytest.fixture(scope="module")
def validator() -> Any:
    jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")
    jsonschema.Draft7Validator.check_schema(schema())
    return jsonschema.Draft7Validator(schema())


@pytest.mark.parametrize("path", sorted((ROOT / "pipelines").glob("*.toml")), ids=lambda path: path.stem)
def test_every_packaged_pipeline_is_valid(path: Any, validator: Any) -> None:
    validator.validate(tomllib.loads(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("said", RIGHT)
def test_what_the_reader_accepts_is_valid(said: str, validator: Any) -> None:
    tables = tomllib.loads(RIGHT[said])
    if "stage" in tables:
        pipeline_from(tables)
    validator.validate(tables)


@pytest.mark.parametrize("said", WRONG)
def test_what_the_reader_refuses_is_not(said: str, validator: Any) -> None:
    tables = tomllib.loads(WRONG[said])
    with pytest.raises(PipelineError):
        pipeline_from(tables)
    assert not validator.is_valid(tables)


def test_every_stage_and_writer_has_its_table_and_every_parameter_its_meaning() -> None:
    found = schema()["properties"]
    for kind, group in GROUPS.items():
        tables = {one["title"]: one for one in found[kind]["items"]["oneOf"]}
        assert tables.keys() == registered(group).keys()
        for name, table in tables.items():
            fields = load(kind, name).model_fields
            assert table["properties"].keys() == {"use"} | {f.alias or key for key, f in fields.items()}
            assert all(one.get("description") for one in table["properties"].values()), name


def test_the_command_prints_it() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "o3dls", "schema"], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert json.loads(done.stdout) == schema()
