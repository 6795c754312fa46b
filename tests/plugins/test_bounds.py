"""Numbers that no run could end with, or no disk could hold, are mistakes that `check` names."""

from __future__ import annotations

from pathlib import Path

import pytest
from tiny import ball_case

from o3dls.cli.main import answer
from o3dls.errors import InputError
from o3dls.io.case_writer import write_case
from o3dls.stages.level_set import LevelSet
from o3dls.stages.level_set_checks import SCALED, check_spacing, spacing_mistake

MISTAKES = [
    ("level_set", "spacing = 1e-9", "level_set.spacing = 1e-09 mm: must be a number within [0.001, inf) mm"),
    ("topology", "spacing = 1e-9", "topology.spacing = 1e-09 mm: must be a number within [0.001, inf) mm"),
    ("icp", "iterations = 10001", "icp.iterations = 10001: must be a whole number within [1, 10000]"),
    ("icp", "iterations = 1000000000000000000", "must be a whole number within [1, 10000]"),
    ("icp", "anneal = 100000", "icp.anneal = 100000: must be a whole number within [0, 10000]"),
    ("icp", "neighbours = 2000", "icp.neighbours = 2000: must be a whole number within [3, 1000]"),
    ("deform", "iterations = 2000", "deform.iterations = 2000: must be a whole number within [15, 1000]"),
    ("deform", f"vector = {[1.0] * 11}", "deform.vector"),
    ("deform", f"normal = {[1.0] * 11}", "deform.normal"),
    (
        "paper_level_set",
        "iterations = 2000",
        "paper_level_set.iterations = 2000: must be a whole number within",
    ),
    ("level_set", "smoothing = 101", "level_set.smoothing = 101: must be a whole number within [0, 100]"),
    ("phases", "iterations = 20000", "phases.iterations = 20000: must be a whole number within [1, 10000]"),
    ("topology", "most_changes = 101", "topology.most_changes = 101: must be a whole number within [1, 100]"),
    ("topology", "most_points = 200000", "topology.most_points = 200000: must be a whole number within [1, "),
    ("icp", f'as = "{"a" * 61}"', "must be text that matches ^[A-Za-z][A-Za-z0-9_-]{0,59}$"),
]


@pytest.mark.parametrize(("stage", "line", "sentence"), MISTAKES)
def test_check_names_what_no_run_could_end_with(
    stage: str, line: str, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "pipe.toml"
    path.write_text(f'[[stage]]\nuse = "{stage}"\n{line}\n')
    assert answer(["check", str(path)]) == 2
    assert sentence in capsys.readouterr().err


def test_check_names_a_volume_to_export_that_is_too_fine(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "pipe.toml"
    path.write_text(
        '[[stage]]\nuse = "icp"\n[[write]]\nuse = "export"\nformat = "mask_nrrd"\nspacing = 1e-9\n'
    )
    assert answer(["check", str(path)]) == 2
    assert "export.spacing = 1e-09 mm: must be a number within [0.001, inf) mm" in capsys.readouterr().err


def test_an_estimate_may_have_a_name_of_sixty_letters(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "pipe.toml"
    path.write_text(f'[[stage]]\nuse = "icp"\nas = "{"a" * 60}"\n')
    assert answer(["check", str(path)]) == 0
    assert "no mistakes" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("spacing", "sentence"), [(0.002, "too large for the memory"), (30.0, "take at most")]
)
def test_check_of_a_case_names_a_grid_that_cannot_hold_it(
    spacing: float, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_case(tmp_path / "ball", ball_case())
    (tmp_path / "pipe.toml").write_text(f'folds = 0\n[[stage]]\nuse = "level_set"\nspacing = {spacing}\n')
    for command in (["check"], ["run", "--out", str(tmp_path / "run")]):
        told = [command[0], str(tmp_path / "pipe.toml"), "--case", str(tmp_path / "ball"), *command[1:]]
        assert answer(told) == 2
        said = capsys.readouterr().err
        assert f"case ball: level_set: spacing = {spacing:g} mm: the surface is 69 mm across" in said
        assert sentence in said


def test_what_may_fit_once_the_prior_is_moved_is_no_mistake() -> None:
    """A prior may become SCALED times larger or smaller; what is refused is refused for both."""
    case = ball_case()
    coarse = 0.1 * case.prior.diagonal * 1.5
    assert spacing_mistake(coarse, case.prior, "mm")
    assert LevelSet(spacing=coarse).mistake(case) is None
    with pytest.raises(InputError, match=r"level_set\.spacing = .* take at most"):
        check_spacing(coarse, case.prior, "mm")
    large = case.prior.with_vertices(case.prior.vertices * SCALED)
    check_spacing(coarse, large, "mm")
