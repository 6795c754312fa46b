"""Values of faces at the vertices: the mean of measurements, the label of most of the area."""

import numpy as np
import pytest

from o3dls.arrays import Array
from o3dls.geometry.face_values import at_vertices
from o3dls.geometry.label_fields import is_label, read_at
from o3dls.geometry.surface import Surface, outline

ROUNDING = 1e-12  # relative: of sums over a few faces


@pytest.fixture(scope="module")
def ball() -> Surface:
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=2, radius=25.0)
    noise = np.random.default_rng(61_408).normal(size=mesh.vertices.shape)  # no two areas are equal
    vertices = np.vstack([mesh.vertices + noise, [[0.0, 0.0, 0.0]]])  # the last one is of no face
    return Surface(vertices, mesh.faces)


def mean_by_loop(surface: Surface, values: Array) -> Array:
    total = np.zeros((len(surface.vertices), *values.shape[1:]))
    weight = np.zeros(len(surface.vertices))
    for face, area, value in zip(surface.faces, surface.face_areas, values, strict=True):
        for vertex in face:
            total[vertex] += area * value
            weight[vertex] += area
    with np.errstate(invalid="ignore"):
        return total / weight.reshape(-1, *[1] * (values.ndim - 1))


@pytest.mark.parametrize("shape", [(), (3,)])
def test_measurements_become_their_mean_weighted_by_area(ball: Surface, shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(30_317).normal(size=(len(ball.faces), *shape))
    found = at_vertices(ball, values)
    np.testing.assert_allclose(found, mean_by_loop(ball, values), atol=ROUNDING)
    assert np.isnan(found[-1]).all()


def test_missing_values_have_no_say(ball: Surface) -> None:
    values = np.where((ball.faces == 5).any(axis=1), np.nan, 7.25)
    found = at_vertices(ball, values)
    assert np.flatnonzero(np.isnan(found)).tolist() == [5, len(ball.vertices) - 1]
    np.testing.assert_allclose(found[~np.isnan(found)], 7.25, rtol=ROUNDING)


def test_labels_become_the_one_of_most_area_and_no_other(ball: Surface) -> None:
    labels = np.random.default_rng(77_041).choice([-3, 11, 40], len(ball.faces))
    found = at_vertices(ball, labels)
    for vertex in range(len(ball.vertices) - 1):
        mine = (ball.faces == vertex).any(axis=1)
        area = {label: ball.face_areas[mine & (labels == label)].sum() for label in set(labels[mine])}
        assert found[vertex] == max(area, key=lambda label: area[label])
    assert np.isnan(found[-1])


def test_equal_areas_give_the_least_label_and_rows_are_one_label() -> None:
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    surface = Surface(square, np.array([[0, 1, 2], [0, 2, 3]]))
    np.testing.assert_array_equal(at_vertices(surface, np.array([9, 4])), [4, 9, 4, 4])
    colours = np.array([[255, 0], [0, 255]])
    np.testing.assert_array_equal(at_vertices(surface, colours), [[0, 255], [255, 0], [0, 255], [0, 255]])


def test_faces_without_area_speak_where_there_is_no_other() -> None:
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]])
    surface = Surface(flat, np.array([[0, 1, 2], [0, 1, 3]]))
    np.testing.assert_allclose(at_vertices(surface, np.array([1.5, 8.0])), [1.5, 1.5, 1.5, 8.0])


def test_outlines_weigh_by_length() -> None:
    surface = outline(np.array([[0.0, 0], [3, 0], [3, 1], [0, 1]]))
    np.testing.assert_allclose(at_vertices(surface, np.array([1.0, 5, 1, 5])), [2, 2, 2, 2])


@pytest.mark.parametrize(
    ("name", "label"),
    [
        ("region", True),
        ("elemTag", True),
        ("RegionId", True),
        ("GroupIDs", True),
        ("scar_class", True),
        ("labels", True),
        ("lat", False),  # whole milliseconds are a measurement
        ("voltage", False),  # tag in the middle of a word
        ("fluid", False),
        ("identity", False),
    ],
)
def test_a_label_in_floating_point_is_known_by_its_name(name: str, label: bool) -> None:
    values = np.array([1.0, 4.0, 4.0])
    assert is_label(name, values) == label
    assert is_label(name, values.astype(np.int32))
    assert not is_label(name, values + 0.5)
    assert not is_label(name, np.append(values, np.nan))
    assert not is_label(name, np.arange(65.0))


def test_between_corners_a_label_is_that_of_most_weight_and_a_measurement_the_mean() -> None:
    values = np.array([7.0, 7.0, 2.0])
    corners = np.array([[0, 1, 2], [0, 1, 2]])
    weights = np.array([[0.3, 0.3, 0.4], [0.2, 0.2, 0.6]])  # two corners of one label weigh together
    np.testing.assert_array_equal(read_at("region", values, corners, weights), [7.0, 2.0])
    whole = read_at("region", values.astype(int), corners, weights)
    assert whole.dtype == np.float64  # as measurements, which may be missing where a surface is far
    np.testing.assert_allclose(read_at("lat", values, corners, weights), [5.0, 4.0], rtol=ROUNDING)


def test_vertices_share_the_area_of_their_faces() -> None:
    corners = np.array([[0.0, 0, 0], [3, 0, 0], [0, 2, 0], [3, 2, 0], [9, 9, 9]])
    surface = Surface(corners, np.array([[0, 1, 2], [1, 3, 2]]))  # two triangles of 3, and a vertex alone
    assert np.allclose(surface.vertex_areas, [1, 2, 2, 1, 0])
    line = Surface(corners[:3, :2], np.array([[0, 1], [1, 2]]))
    assert np.allclose(line.vertex_areas.sum(), line.area)
