"""Regularised zero sets: far fewer faces, the same topology, the same surface."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import meshed, round_distance, torus_distance, whole_box

from o3dls.adapters.self_intersections import self_intersections
from o3dls.evaluation.distances import distances
from o3dls.geometry.components import components_and_euler
from o3dls.geometry.surface import Surface
from o3dls.levelset.grid.isosurface import zero_set
from o3dls.levelset.grid.regularised import regularised


def faces_of_edges(surface: Surface) -> np.ndarray:
    """How many faces each edge has."""
    ends = np.sort(surface.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return np.unique(ends, axis=0, return_counts=True)[1]


@pytest.mark.parametrize("distance", [round_distance(15.0), torus_distance()], ids=["ball", "torus"])
def test_a_zero_set_keeps_place_and_topology_with_a_third_of_its_faces(distance) -> None:  # type: ignore[no-untyped-def]
    whole = meshed(distance, 22.0)
    fewer = regularised(whole, 1.0)
    assert len(fewer.faces) < 0.3 * len(whole.faces)
    assert (faces_of_edges(fewer) == 2).all()
    assert components_and_euler(fewer.vertices, fewer.faces) == components_and_euler(
        whole.vertices, whole.faces
    )
    assert distances(fewer.vertices, whole).max() < 0.1  # a mean lies in the chord: h^2 / 8r and less
    assert self_intersections(fewer) == 0
    assert fewer.volume == pytest.approx(whole.volume, rel=0.01)


@pytest.mark.parametrize("seed", range(5))
def test_no_pinch_handle_or_island_is_lost_or_made(seed: int) -> None:
    """Values at random: every cell is as ambiguous as can be, and walls pass within a cell of each other."""
    noise = np.random.default_rng(seed)
    band, distance = whole_box(round_distance(6.0), 10.0, 1.0)
    phi = distance + noise.normal(0.0, 1.5, len(distance))
    border = (np.abs(band.positions) > 8.5).any(axis=1)
    whole = Surface(*zero_set(band, np.where(border, 3.0, phi)))
    fewer = regularised(whole, 1.0)
    kept = components_and_euler(whole.vertices, whole.faces)
    assert kept != (1, 2)  # or nothing is asked here
    assert components_and_euler(fewer.vertices, fewer.faces) == kept
    assert (faces_of_edges(fewer) == 2).all()
    assert len(fewer.faces) < 0.8 * len(whole.faces)
    assert self_intersections(whole) == 0
