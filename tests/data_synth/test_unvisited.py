"""Maps that leave wall out: points are where a catheter was and nowhere else, the truth is the whole anatomy,
and short veins are made longer without harm.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from veined import CHAMBER, veined

from data_synth import Mapping, Visits, lengthened, read_wall, unvisited
from data_synth.chamber import ROOT, chamber
from data_synth.sampling import filtered, sites
from data_synth.wall import crosses
from o3dls import Case, InputError, Surface, read_case, write_case
from o3dls.evaluation.distances import distances

SEED = 48_611
LONG = 40.0  # mm beyond the chamber
NOISE = 1.5
EDGE = 2.5  # mm: a face's own size, between a corner that was visited and a point on it


@pytest.fixture(scope="module")
def rest() -> Surface:
    return veined(LONG)


def made(
    rest: Surface, where: str, *, points: int = 600, noise: float = 0.0, clustered: bool = False
) -> Case:
    how = Mapping(points, noise, clustered)
    return unvisited(rest, SEED, Visits(where), family="piston", how=how)


def wall_of(case: Case) -> Surface:
    assert case.truth is not None
    assert case.truth.surface is not None
    return case.truth.surface


def depth_and_tube(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Of the mapping points, by the nearest vertex of the true wall."""
    wall = wall_of(case)
    at = case.points.of("eam").xyz
    row = np.array([np.linalg.norm(wall.vertices - p, axis=1).argmin() for p in at])
    return wall.fields["depth_mm"][row], wall.fields["tube"][row]


def test_the_parts_of_a_chamber_are_its_body_and_its_veins(rest: Surface) -> None:
    parts = chamber(rest)
    assert parts.tubes == 4
    away = np.linalg.norm(rest.vertices, axis=1)
    assert parts.depth[away < CHAMBER + 0.5].max() < 3.0 + ROOT
    for k in range(4):
        assert parts.depth[parts.tube == k].max() == pytest.approx(LONG, abs=3.0)
    deep = parts.tube >= 0
    assert np.abs(parts.depth[deep] - (away[deep] - CHAMBER)).max() < 3.5


@pytest.mark.parametrize("clustered", [False, True])
def test_points_reach_no_deeper_than_catheters(clustered: bool, rest: Surface) -> None:
    case = made(rest, "all", clustered=clustered)
    depth, tube = depth_and_tube(case)
    assert 8.0 < depth.max() < 12.0 + EDGE
    assert {0, 1, 2, 3} <= set(tube[depth > 5.0])
    noisy = made(rest, "all", noise=NOISE, clustered=clustered)
    assert depth_and_tube(noisy)[0].max() < 12.0 + EDGE + 4.0 * NOISE


def test_a_skipped_vein_has_no_point_and_the_others_have(rest: Surface) -> None:
    depth, tube = depth_and_tube(made(rest, "skipped"))
    without = [k for k in range(4) if not (depth[tube == k] > ROOT + EDGE).any()]
    assert len(without) == 1


@pytest.mark.parametrize(("where", "share"), [("half", 0.5), ("threequarters", 0.75)])
def test_a_part_map_has_its_share_of_the_wall_that_can_be_reached(
    where: str, share: float, rest: Surface
) -> None:
    seen, of = (~case.truth.unseen for case in (made(rest, where), made(rest, "all")))
    assert seen.sum() / of.sum() == pytest.approx(share, abs=0.06)
    assert not (seen & ~of).any()


def test_unseen_wall_is_where_no_catheter_was(rest: Surface) -> None:
    case = made(rest, "all", points=3000)
    gap = np.linalg.norm(case.truth.held_out[:, None] - case.points.of("eam").xyz[::2], axis=2).min(axis=1)
    assert np.median(gap[~case.truth.unseen]) < 1.5
    assert np.median(gap[case.truth.unseen]) > 8.0


def test_landmarks_are_marked_where_the_catheter_was(rest: Surface) -> None:
    case = made(rest, "half")
    _, prior, marks = case.landmark_pairs()
    assert len(marks) == 4
    assert distances(prior, rest).max() < 1e-3
    seen = case.truth.held_out[~case.truth.unseen]
    assert np.linalg.norm(marks[:, None] - seen, axis=2).min(axis=1).max() < 4.0 * 2.0 + EDGE


def test_the_whole_anatomy_is_the_truth(rest: Surface) -> None:
    case = made(rest, "half")
    at, to = case.truth.correspondence
    assert distances(at, case.prior).max() < 1e-9
    assert distances(to, wall_of(case)).max() < 1e-9
    assert len(wall_of(case).vertices) == len(rest.vertices)


def test_the_same_seed_gives_the_same_case_and_where_the_catheter_was_leaves_the_motion_alone(
    rest: Surface,
) -> None:
    one, again, other = made(rest, "half"), made(rest, "half"), made(rest, "all")
    assert np.array_equal(one.points.xyz, again.points.xyz)
    assert np.array_equal(wall_of(one).vertices, wall_of(other).vertices)
    assert np.array_equal(one.truth.unseen, again.truth.unseen)


def test_the_case_folder_says_what_is_vein(rest: Surface, tmp_path: Path) -> None:
    case = made(rest, "skipped")
    write_case(tmp_path / "c", case)
    again = wall_of(read_case(tmp_path / "c"))
    assert again.fields["depth_mm"] == pytest.approx(wall_of(case).fields["depth_mm"], abs=1e-4)


def test_a_density_filter_keeps_points_apart(rest: Surface) -> None:
    def nearest(at: np.ndarray) -> np.ndarray:
        gap = np.linalg.norm(at[:, None] - at, axis=2) + np.diag(np.full(len(at), np.inf))
        return np.asarray(gap.min(axis=1))

    rng = np.random.default_rng(SEED)
    kept, plain = filtered(rng, rest, 400).xyz, sites(rng, rest, 400).xyz
    assert len(kept) == 400
    assert nearest(kept).min() > 0.6 * np.sqrt(rest.area / 400)
    assert nearest(plain).min() < 0.2 * np.sqrt(rest.area / 400)


def test_another_word_for_where_the_catheter_was() -> None:
    with pytest.raises(InputError, match="visits 'quarter': must be one of all, skipped"):
        Visits("quarter")


def test_short_veins_are_made_longer_and_nothing_else() -> None:
    short = veined(14.0)
    longer = lengthened(short, SEED)
    assert longer.watertight
    assert not crosses(longer).any()
    before, after = chamber(short), chamber(longer)
    assert after.tubes == before.tubes == 4
    gained = after.depth.max() - before.depth.max()
    assert 9.0 < gained < 30.0
    body = short.vertices[before.depth == 0.0]
    assert distances(body, longer).mean() < 0.3
    assert np.array_equal(longer.vertices, lengthened(short, SEED).vertices)


def test_long_veins_are_left_as_they_are(rest: Surface) -> None:
    kept = lengthened(rest, SEED)
    assert np.abs(np.ptp(kept.vertices, axis=0) - np.ptp(rest.vertices, axis=0)).max() < 1.5


@pytest.mark.parametrize("name", ["la_60", "la_61"])
def test_veins_of_a_mask_are_made_longer(name: str, shared_data: Path) -> None:
    short = read_wall(shared_data / "priors" / "lasc2018" / f"{name}.ply", None)
    longer = lengthened(short)
    assert longer.watertight
    assert len(longer.vertices) - len(longer.faces) // 2 == 2
    assert 1.05 * short.area < longer.area < 1.6 * short.area
