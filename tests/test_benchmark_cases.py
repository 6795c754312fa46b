"""Cases are grouped by their names, and groups that are alike share the peers' settings."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from benchmarks import cases
from benchmarks.cases import find, tuned_as


@pytest.mark.parametrize(
    ("name", "group", "tuned"),
    [
        ("la_17", "la", "la"),
        ("jar_03_2001", "jar_03", "jar_03"),
        ("cross_250_1_even_2101", "cross_250_1_even", "cross_250"),
        ("cross_20000_1_clustered_outliers_2103", "cross_20000_1_clustered_outliers", "cross_20000"),
        ("family_flow_1_landmarks_2301", "family_flow_1_landmarks", "family_flow_1"),
        ("family_arap_2_rough_301", "family_arap_2_rough", "family_arap_2"),
        ("whole_20000_clustered_3104", "whole_20000_clustered", "whole_20000_clustered"),
        ("path_dragged_500_3204", "path_dragged_500", "path_dragged_500"),
        ("shuffled_groups_250_3201", "shuffled_groups_250", "shuffled_groups_250"),
        ("unvisited_half_350_even_705", "unvisited_half_350_even", "unvisited_half_350_even"),
        (
            "badly_segmented_250_clustered_2902",
            "badly_segmented_250_clustered",
            "badly_segmented_250_clustered",
        ),
        ("cross_250_2_even_2101", "cross_250_2_even", "cross_250"),
        (
            "cross_250_2_clustered_outliers_2101",
            "cross_250_2_clustered_outliers",
            "cross_250_2_clustered_outliers",
        ),
        ("crowd_1000_3301", "crowd_1000", "crowd_1000"),
        ("kit_mri_to_eam", "kit_mri_to_eam", "kit_mri_to_eam"),
    ],
)
def test_groups_by_name(name: str, group: str, tuned: str, tmp_path: Path) -> None:
    (tmp_path / name).mkdir()
    for file in ("points.csv", "prior.ply"):
        (tmp_path / name / file).touch()
    (found,) = find([tmp_path])
    assert (found.group, tuned_as(found.group)) == (group, tuned)


@pytest.mark.parametrize("which", cases.SETS)
def test_development_and_judging_share_no_seed_and_no_name(which: str) -> None:
    development, judging = (list(cases.SETS[which](judging)) for judging in (False, True))
    assert not {w.seed for w in development} & {w.seed for w in judging}
    for wanted in (development, judging):
        assert len({w.name for w in wanted}) == len(wanted)
    assert max(w.seed for w in development) < 1000 < 2000 < min(w.seed for w in judging)


def test_every_atrium_is_the_prior_of_every_other_once_per_kind() -> None:
    kinds: dict[str, set[tuple[str, str | None]]] = {}
    for one in cases.paired(judging=False):
        kinds.setdefault(one.name.rpartition("_")[0], set()).add((one.prior, one.truth))
    assert len(kinds) == 4
    assert all(len(pairs) == 20 and all(a != b for a, b in pairs) for pairs in kinds.values())


def test_crossed_pairs_of_judging_are_twenty_and_of_other_atria() -> None:
    pairs = [{(w.prior, w.truth) for w in cases.crossed(judging)} for judging in (False, True)]
    assert len(pairs[1]) == 20
    assert not {a for pair in pairs[0] for a in pair} & {a for pair in pairs[1] for a in pair}


def test_masks_of_the_challenge_develop_up_to_79_and_judge_from_80() -> None:
    for judging, names in ((False, cases.OWN_DEVELOPMENT), (True, cases.OWN_JUDGING)):
        numbers = [int(Path(name).stem.removeprefix("la_")) for name in names if name.startswith("lasc2018")]
        assert len(numbers) == (10 if judging else 5)
        assert all((80 <= k <= 99) == judging for k in numbers)


def test_every_kind_of_visit_meets_every_number_of_points_and_every_atrium() -> None:
    judged = list(cases.left_out(judging=True))
    assert len(judged) == 120
    kinds = Counter(one.name.rpartition("_")[0] for one in judged)
    assert len(kinds) == 4 * 4 * 2
    assert set(kinds.values()) == {3, 4}
    assert set(Counter(one.prior for one in judged).values()) == {8}


def test_badly_segmented_priors_are_ten_and_twenty() -> None:
    assert [len(list(cases.bad_priors(judging))) for judging in (False, True)] == [10, 20]


def test_forty_pairs_start_without_landmarks_half_of_them_without_a_pose(shared_data: Path) -> None:
    judged = list(cases.without_landmarks(judging=True))
    assert len(judged) == len({(one.prior, one.truth) for one in judged}) == 40
    assert sum(one.unknown for one in judged) == 20
    assert all(one.prior != one.truth for one in judged)
    for way, posed in (("rough", True), ("unknown", False)):
        found = next(one for one in cases.without_landmarks(judging=False) if way in one.name).case(
            shared_data
        )
        assert not found.prior_landmarks
        assert not (found.points.type == "landmark").any()
        assert (found.init is not None) == posed
        assert found.prior_of == "template"
