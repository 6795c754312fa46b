"""Every pipeline file that comes with the package checks and runs, and the default leaves out what a case
does not allow.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tiny import ball_case, disc_case

from o3dls.pipeline.file import all_mistakes, default_pipeline, read_pipeline
from o3dls.resources import pipeline_files

FLAT = {"star"}  # made for 2D cases
CLOSER = 0.5  # the last estimate halves the distance of the prior as it stands from the truth, at least


@pytest.mark.parametrize("name", pipeline_files())
def test_a_packaged_pipeline_has_no_mistake(name: str) -> None:
    assert all_mistakes(pipeline_files()[name]) == []


@pytest.mark.parametrize("name", pipeline_files())
def test_a_packaged_pipeline_runs(name: str, tmp_path: Path) -> None:
    case = disc_case() if name in FLAT else ball_case(points=150)
    pipeline = read_pipeline(pipeline_files()[name], ["folds=0"])
    run = pipeline.run(case)
    folder = run.write(tmp_path / "run")
    assert run.faults == []
    unit = run.unit
    still = {"px": 0.63, "mm": 0.66}[unit]  # mean distance between the prior as it stands and the truth
    assert run.scores[run.final]["truth"][f"assd_{unit}"] < CLOSER * still
    assert (folder / "report.html").stat().st_size > 10_000
    assert bool(list(folder.glob("export/*"))) == any(writer.name == "export" for writer in pipeline.writes)


def test_the_default_does_what_the_case_allows() -> None:
    full = default_pipeline()
    assert [stage.name for stage in full.stages] == ["landmarks", "icp", "deform", "topology", "level_set"]
    assert [writer.name for writer in full.writes] == ["report", "export"]
    unnamed = full.allowed_by(replace(ball_case(), prior_landmarks={}))
    assert [stage.name for stage in unnamed.stages] == ["icp", "deform", "topology", "level_set"]
    flat = full.allowed_by(disc_case())
    assert [stage.name for stage in flat.stages] == ["icp", "deform", "topology", "level_set"]
    assert [writer.name for writer in flat.writes] == ["report"]
