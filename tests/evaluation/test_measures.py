"""Numbers of a surface are those of geometry, and their intervals those of its samples."""

from __future__ import annotations

import numpy as np
import pytest
from fields import bend, body, spots, wall
from scipy.stats import norm
from tiny import sphere

from o3dls.estimate import Estimate
from o3dls.evaluation.measures.areas import share_below
from o3dls.evaluation.measures.intervals import LEVEL, WIDER, measure_samples, sample_numbers
from o3dls.evaluation.measures.numbers import (
    Parts,
    Quantity,
    measure_surface,
    named_parts,
    places_on,
    slopes,
)
from o3dls.evaluation.measures.ways import shortest_ways
from o3dls.evaluation.regions import tubes
from o3dls.geometry.surface import Surface
from o3dls.geometry.twist import rotation
from o3dls.motion.fit import fit_motion
from o3dls.motion.wall.samples import SurfaceSamples
from tests.chamber import chamber, tips

RADIUS = 20.0
BALL = sphere(RADIUS, 60)
ALL = np.ones(len(BALL.vertices), dtype=bool)
MESHED = 0.004  # relative: the triangles of a ball lie inside of it


def samples_of(surface: Surface, *vertices: np.ndarray) -> SurfaceSamples:
    at = np.array(vertices)
    return SurfaceSamples(surface, at, np.ones(at.shape[:2], dtype=bool))


def test_a_ball_has_the_volume_the_area_and_the_sections_of_one() -> None:
    height = 12.0
    parts = Parts(
        named_parts(None, {}, ALL),
        tubes={"cap": BALL.vertices[:, 2] > height},
        places=places_on(BALL, {"a": np.array([0.0, 0.0, 21.0]), "b": np.array([0.0, 0.0, -19.0])}),
    )
    found = {(one.what, one.where): value for one, value in measure_surface(BALL, parts).items()}
    assert found["volume", "wall"] == pytest.approx(4.0 / 3.0 * np.pi * 8.0, rel=MESHED)
    assert found["area", "wall"] == pytest.approx(4.0 * np.pi * 4.0, rel=MESHED)
    # the border is the first ring of vertices above the height
    ring = BALL.vertices[BALL.vertices[:, 2] > height, 2].min()
    across = 2.0 * np.sqrt(RADIUS**2 - ring**2)
    assert found["section diameter", "cap"] == pytest.approx(across, rel=MESHED)
    assert found["section area", "cap"] == pytest.approx(np.pi * across**2 / 400.0, rel=2.0 * MESHED)
    assert found["distance", "a to b"] == pytest.approx(40.0)  # each keeps its offset from the wall


def test_a_section_does_not_depend_on_what_lies_beyond_it() -> None:
    beyond = BALL.vertices[:, 2] > 12.0
    parts = Parts({}, tubes={"cap": beyond})
    faces = BALL.faces[beyond[BALL.faces].all(axis=1)]
    inner = np.setdiff1d(faces, BALL.faces[~beyond[BALL.faces].all(axis=1)])
    pulled = BALL.vertices.copy()
    pulled[inner] += [3.0, 0.0, 25.0]
    for one, value in measure_surface(BALL.with_vertices(pulled), parts).items():
        if one.what.startswith("section"):
            assert value == pytest.approx(measure_surface(BALL, parts)[one])


def test_a_section_is_the_sum_of_the_area_vectors_of_the_faces_beyond() -> None:
    beyond = (BALL.vertices[:, 2] > 12.0) | (BALL.vertices @ [0.6, 0.8, 0.0] > 17.0)  # two pieces
    pulled = BALL.vertices + np.random.default_rng(5_519).normal(scale=0.3, size=BALL.vertices.shape)
    a, b, c = (pulled[BALL.faces[beyond[BALL.faces].all(axis=1), k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a).sum(axis=0)) / 100.0
    found = measure_surface(BALL.with_vertices(pulled), Parts({}, tubes={"cap": beyond}))
    assert found[Quantity("section area", "cap", "cm²")] == pytest.approx(area)


def test_ways_lead_along_the_wall_and_are_hardly_longer_than_great_circles() -> None:
    n = len(BALL.vertices)
    ends = {"a": 3, "b": n // 2, "c": n - 5}
    ways = shortest_ways(BALL, np.ones(n, dtype=bool), ends)
    assert list(ways) == [("a", "b"), ("a", "c"), ("b", "c")]
    found = measure_surface(BALL, Parts({}, ways=ways))
    for (a, b), way in ways.items():
        assert (way[0], way[-1]) == (ends[a], ends[b])
        one, other = (BALL.vertices[ends[name]] / RADIUS for name in (a, b))
        circle = RADIUS * np.arccos(one @ other)
        length = found[Quantity("length", f"{a} to {b}", "mm")]
        assert 0.99 * circle < length < 1.05 * circle
    larger = measure_surface(BALL.with_vertices(1.5 * BALL.vertices), Parts({}, ways=ways))
    assert larger[Quantity("length", "a to b", "mm")] == pytest.approx(
        1.5 * found[Quantity("length", "a to b", "mm")]
    )


def test_a_way_goes_round_what_is_no_wall_and_there_is_none_to_an_island() -> None:
    x, y = BALL.vertices[:, 0], BALL.vertices[:, 1]
    ends = {"a": int(np.argmax(x + 0.3 * y)), "b": int(np.argmax(-x + 0.3 * y))}
    top = y < 0.8 * RADIUS
    free = shortest_ways(BALL, np.ones(len(x), dtype=bool), ends)["a", "b"]
    assert (~top)[free].any()
    round_it = shortest_ways(BALL, top, ends)["a", "b"]
    assert top[round_it].all()
    assert shortest_ways(BALL, np.abs(x) > 0.3 * RADIUS, ends) == {}


def test_area_below_a_threshold_is_counted_where_there_is_wall_and_a_value() -> None:
    z = BALL.vertices[:, 2]
    values = np.where(BALL.vertices[:, 0] > 0.0, z, np.nan)
    parts = Parts({"upper": z > 0.0}, thresholds=(10.0,))
    found = {one.what: value for one, value in measure_surface(BALL, parts, None, values).items()}
    # Archimedes: a zone has the area of its height; half of the upper half has values
    assert found["area below 10 mV"] == pytest.approx(0.5 * 2.0 * np.pi * 2.0 * 1.0, rel=0.05)
    assert found["share below 10 mV"] == pytest.approx(50.0, rel=0.05)
    absent = measure_surface(BALL, parts, BALL.vertices[:, 1] > 0.0, values)
    assert absent[Quantity("area", "upper", "cm²")] == pytest.approx(found["area"] / 2.0, rel=0.03)


def test_a_face_counts_by_the_part_of_it_that_lies_below_the_threshold() -> None:
    """Of a field that is linear on a triangle, by the areas of its cut-off corners."""
    found = share_below(
        np.array([[0.0, 2.0, 4.0], [4.0, 0.0, 2.0], [3.0, 3.0, 3.0], [0.0, np.nan, 0.0]]), 1.0
    )
    assert found == pytest.approx([0.125, 0.125, 0.0, 0.0])
    assert share_below(np.array([[0.0, 2.0, 4.0]]), 3.0) == pytest.approx([0.875])
    rng = np.random.default_rng(8_221)
    corners = rng.normal(size=(5, 3))
    inside = rng.dirichlet(np.ones(3), 40_000) @ corners.T < 0.2
    assert share_below(corners, 0.2) == pytest.approx(inside.mean(axis=0), abs=0.01)


def test_slopes_are_the_gradient_along_the_wall() -> None:
    way = np.array([0.3, -1.2, 0.7])
    values = BALL.vertices @ way
    normals = BALL.vertices / RADIUS
    expected = way - (normals @ way)[:, None] * normals
    assert np.abs(slopes(BALL, values) - expected).max() < 0.1
    values[5] = np.nan
    assert np.isfinite(slopes(BALL, values)).all()


@pytest.mark.parametrize(("template", "wider"), [(True, WIDER), (False, 1.0)])
def test_intervals_of_a_volume_are_about_that_of_the_surface_and_wider_of_another_s_wall(
    template: bool, wider: float
) -> None:
    radii = RADIUS + np.random.default_rng(51_773).normal(0.0, 0.5, 400)
    samples = samples_of(BALL, *(BALL.vertices * r / RADIUS for r in radii))
    volume = next(
        m for m in measure_samples(samples, Parts({}, template=template)) if m.quantity.what == "volume"
    )
    drawn = radii**3 * volume.naive / RADIUS**3
    expected = volume.naive + wider * (np.quantile(drawn, [0.025, 0.975]) - drawn.mean())
    assert (volume.low, volume.high) == pytest.approx(tuple(expected))
    assert volume.mean == pytest.approx(volume.naive)


def test_a_wall_that_may_not_exist_is_taken_off_and_not_made_wider() -> None:
    """What is half there has half of its area in the mean, whatever the errors of the rest."""
    upper = BALL.vertices[:, 2] > 0.0
    exists = np.array([np.ones(len(ALL), dtype=bool), ~upper] * 20)
    at = np.repeat(BALL.vertices[None], 40, axis=0)
    parts = Parts({"all": ALL, "upper": upper})
    found = {m.quantity.where: m for m in measure_samples(SurfaceSamples(BALL, at, exists), parts)}
    assert found["upper"].mean == pytest.approx(found["upper"].naive / 2.0)
    assert (found["upper"].low, found["upper"].high) == pytest.approx((0.0, found["upper"].naive))
    assert found["all"].low == pytest.approx(found["all"].naive - found["upper"].naive)
    assert found["wall"].low == pytest.approx(BALL.volume / 1000.0)


def test_a_number_that_can_not_be_below_0_has_no_interval_there() -> None:
    """Nor a share above 100 %."""
    values = np.where(BALL.vertices[:, 2] > 0.97 * RADIUS, 0.0, 2.0)
    turns = 0.3 * np.random.default_rng(20_747).normal(size=(60, 3))
    samples = samples_of(BALL, *(BALL.vertices @ rotation(turn).T for turn in turns))
    cap = BALL.vertices[:, 2] > 0.9 * RADIUS
    for one in measure_samples(samples, Parts({"cap": cap}, thresholds=(1.0,)), values):
        assert one.low >= 0.0
        assert one.high <= 100.0 or one.quantity.unit != "%"


def test_values_stay_in_the_map_while_the_wall_slides_under_them() -> None:
    """Half a ball that is turned by an angle has so much less of what lies below 0 on the other half."""
    angle = 0.06
    turn = rotation(np.array([0.0, 0.0, angle]))
    parts = Parts({"half": BALL.vertices[:, 1] > 0.0}, thresholds=(0.0,))
    found = sample_numbers(samples_of(BALL, BALL.vertices @ turn.T), parts, BALL.vertices[:, 0] * 1.0)
    # a turn by the angle brings so much of the half to where the value is below 0
    below = found[Quantity("share below 0 mV", "half", "%")]
    assert below == pytest.approx(50.0 + 100.0 * angle / np.pi, abs=1.0)


def test_a_region_without_values_has_no_share_and_no_interval() -> None:
    values = np.full(len(ALL), np.nan)
    measures = measure_samples(
        samples_of(BALL, BALL.vertices), Parts({"wall": ALL}, thresholds=(1.0,)), values
    )
    share = next(m for m in measures if m.quantity.what.startswith("share"))
    assert np.isnan([share.naive, share.low, share.high]).all()


def test_tubes_are_the_named_veins_beyond_their_mouths() -> None:
    surface = chamber()
    marks = tips(surface)
    found = tubes(surface, marks)
    assert found.keys() <= marks.keys()
    assert len(found) >= 2
    for name, inside in found.items():
        away = np.linalg.norm(surface.vertices[inside] - marks[name], axis=1)
        assert away.min() == pytest.approx(0.0)
        assert away.max() < 15.0
    assert tubes(surface, {}) == {}


def test_an_interval_holds_what_was_drawn_from_the_posterior_as_often_as_it_says() -> None:
    """Of truths that are drawn from the posterior itself 95 % lie between the quantiles of its samples, and
    as many more in the interval as that is wider, which those of sections and volumes are not.
    """
    surface = body(3)
    truth = surface.vertices + bend(surface, 4_409)
    _, face, bary = spots(surface, 150, 4_410)
    points = np.einsum("nc,ncd->nd", bary, truth[surface.faces[face]])
    data = wall(points + 0.8 * np.random.default_rng(4_411).normal(size=points.shape))
    fit = fit_motion(surface.vertices, surface.faces, np.eye(4), data)
    moved = surface.with_vertices(fit.vertices)
    estimate = Estimate(moved, np.eye(4), "made", motion=fit.motion)
    parts = Parts(
        {"half": surface.vertices[:, 0] > 0.0},
        tubes={"cap": surface.vertices[:, 2] > 15.0},
        places={"a": (0, np.zeros(3)), "b": (100, np.zeros(3))},
    )
    samples = estimate.samples(1000, seed=3_181)
    measures, plain = measure_samples(samples, parts), sample_numbers(samples, parts)
    truths = estimate.samples(400, seed=91_120)
    drawn = [measure_surface(one, parts) for one in truths]
    for one in measures:
        values = np.array([value[one.quantity] for value in drawn])
        low, high = np.quantile(plain[one.quantity], [0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL])
        # of 400, which know a share to 1 %
        assert ((values >= low) & (values <= high)).mean() == pytest.approx(LEVEL, abs=0.035), one.quantity
        factor = 1.0 if one.quantity.what.startswith(("section", "volume")) else WIDER
        wider = 2.0 * norm.cdf(factor * norm.ppf(0.5 + 0.5 * LEVEL)) - 1.0
        # these truths are as rough as samples, and larger by as much, which intervals leave out
        values = values - plain[one.quantity].mean() + one.naive
        within = float(((values >= one.low) & (values <= one.high)).mean())
        assert within == pytest.approx(wider, abs=0.03), one.quantity
