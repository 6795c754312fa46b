"""What people hold in memory besides meshes: tables, structured arrays, tensors, scenes; and what is said."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import open3d as o3d
import pytest
import trimesh
from tiny import Nudge, ball_case

import o3dls
from o3dls.adapters.keywords import in_keywords
from o3dls.errors import InputError
from o3dls.geometry.surface import Surface

BALL = ball_case(points=40)
XYZ = BALL.points.of("eam").xyz
BIPOLAR = np.linspace(0.1, 2.0, len(XYZ))
NAMES = ["x", "y", "z", "bipolar"]
COLUMNS = dict(zip(NAMES, (*XYZ.T, BIPOLAR), strict=True))


class Table:
    """As pandas and polars: columns by name, which have `to_numpy` or become arrays."""

    def __init__(self, columns: dict[str, Any]) -> None:
        self.held = columns
        self.columns = list(columns)

    def __getitem__(self, name: str) -> Any:
        return self.held[name]


class Tensor:
    """As a tensor of torch on a graphics card, with a gradient: numpy takes it from the processor alone."""

    def __init__(self, values: np.ndarray, place: str = "cuda", graph: bool = True) -> None:
        self.values, self.place, self.graph = values, place, graph

    def detach(self) -> Tensor:
        return Tensor(self.values, self.place, graph=False)

    def cpu(self) -> Tensor:
        return Tensor(self.values, "cpu", self.graph)

    def numpy(self) -> np.ndarray:
        if self.place != "cpu" or self.graph:
            raise RuntimeError("can't convert this tensor to numpy")
        return self.values


class Wrapped:
    """As arrays of other libraries: an array by the protocol of numpy."""

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return XYZ.astype(dtype or float)


def structured() -> np.ndarray:
    rows = list(map(tuple, np.column_stack([XYZ, BIPOLAR]).tolist()))
    return np.array(rows, dtype=[(name, "f8") for name in NAMES])


HELD: dict[str, Callable[[], Any]] = {
    "mapping": lambda: COLUMNS,
    "table": lambda: Table(COLUMNS),
    "table of lists": lambda: Table({name: list(values) for name, values in COLUMNS.items()}),
    "table of tensors": lambda: Table({name: Tensor(values) for name, values in COLUMNS.items()}),
    "headings with units": lambda: Table({f"{n} (mm)" if n in "xyz" else n: v for n, v in COLUMNS.items()}),
    "headings of ParaView": lambda: dict(
        zip(["Points:0", "Points:1", "Points:2", "Bipolar"], COLUMNS.values(), strict=True)
    ),
    "structured": structured,
    "record": lambda: structured().view(np.recarray),
    "array": lambda: XYZ,
    "__array__": Wrapped,
    "Vector3dVector": lambda: o3d.utility.Vector3dVector(XYZ),
    "Tensor of Open3D": lambda: o3d.core.Tensor(XYZ),
    "tensor": lambda: Tensor(XYZ),
    "scene of a cloud": lambda: trimesh.Scene(trimesh.PointCloud(XYZ)),
}


@pytest.mark.parametrize("kind", HELD)
def test_whatever_has_places_is_points(kind: str) -> None:
    points = o3dls.points_of(HELD[kind]())
    np.testing.assert_array_equal(points.xyz, XYZ)
    if "bipolar" in points.columns:
        np.testing.assert_array_equal(points.columns["bipolar"], BIPOLAR)
    assert ("bipolar" in points.columns) == (list(HELD).index(kind) < list(HELD).index("array"))


def test_a_table_of_pandas_is_points() -> None:
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame(COLUMNS | {"name": ["a", *[None] * (len(XYZ) - 1)]})
    table["lat"] = pandas.array([1.0, None] * (len(XYZ) // 2), dtype="Float64")
    points = o3dls.points_of(table)
    np.testing.assert_array_equal(points.xyz, XYZ)
    np.testing.assert_array_equal(points.columns["lat"][:2], [1.0, np.nan])
    assert points.columns["name"][:2].tolist() == ["a", ""]


@pytest.mark.parametrize("missing", [None, float("nan"), "NA", "<NA>"])
def test_gaps_of_a_table_are_missing(missing: Any) -> None:
    lat = [missing, *range(len(XYZ) - 1)]
    points = o3dls.points_of(Table(COLUMNS | {"lat": np.array(lat, dtype=object)}))
    np.testing.assert_array_equal(points.columns["lat"], [np.nan, *range(len(XYZ) - 1)])


@pytest.mark.parametrize(
    ("thing", "sentence"),
    [
        (None, "an object of type builtins.NoneType holds no points"),
        (3.0, "an object of type builtins.float holds no points"),
        ("points.csv", "an object of type builtins.str holds no points"),
        (object(), "an object of type builtins.object holds no points"),
        (Table({"u": XYZ[:, 0]}), "columns are u: there must be x, y, z"),
        (Table({f"{n} [cm]": v for n, v in COLUMNS.items()}), r"say units='cm'"),
        (trimesh.Scene(), "the scene holds 0 geometries .* it is empty"),
        (Tensor(XYZ[:, :1]), r"have shape \(40, 1\): must be \(n, 3\)"),
    ],
)
def test_what_holds_no_points_is_named(thing: Any, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        o3dls.points_of(thing)


def test_a_scene_is_its_one_mesh_where_it_stands() -> None:
    """`trimesh.load` returns a scene for most formats."""
    mesh = o3dls.to(BALL.prior, "trimesh")
    move = trimesh.transformations.translation_matrix([1.0, 2.0, 3.0])
    scene = trimesh.Scene()
    scene.add_geometry(mesh, transform=move)
    np.testing.assert_allclose(o3dls.surface_of(scene).vertices, BALL.prior.vertices + np.array([1, 2, 3]))
    scene.add_geometry(mesh, geom_name="other")
    with pytest.raises(InputError, match=r"holds 2 geometries of type Trimesh: must be one; .*other"):
        o3dls.surface_of(scene)


@pytest.mark.parametrize("make", [Tensor, o3d.core.Tensor, np.ndarray.tolist])
def test_a_pair_may_be_of_tensors(make: Callable[[np.ndarray], Any]) -> None:
    surface = o3dls.surface_of((make(BALL.prior.vertices), make(BALL.prior.faces)))
    np.testing.assert_array_equal(surface.vertices, BALL.prior.vertices)
    np.testing.assert_array_equal(surface.faces, BALL.prior.faces)


def test_errors_name_keyword_arguments() -> None:
    hole = Surface(BALL.prior.vertices, BALL.prior.faces[1:])
    with pytest.raises(InputError, match=r"prior: is open .*; say cap=True to close it$"):
        o3dls.case_of(hole, XYZ)
    assert o3dls.case_of(hole, XYZ, cap=True).prior.watertight
    nibabel = pytest.importorskip("nibabel")
    labels = np.zeros((12, 12, 12), dtype=np.uint8)
    labels[2:5, 2:5, 2:5], labels[7:10, 7:10, 7:10] = 1, 2
    image = nibabel.Nifti1Image(labels, np.eye(4))
    with pytest.raises(InputError, match=r"holds 2 labels; say label= \(there are 1, 2\)"):
        o3dls.surface_of(image)
    assert o3dls.surface_of(image, label=2).volume > 0
    with pytest.raises(InputError, match="say units='m', else units='mm'"):
        o3dls.case_of((BALL.prior.vertices / 1000, BALL.prior.faces), XYZ / 1000)
    small = o3dls.case_of(BALL.prior, XYZ / 10)
    with pytest.raises(InputError, match=r"if the points are in cm, multiply them by 10"):
        o3dls.Pipeline([Nudge()]).run(small)


def test_sentences_without_options_stay_as_they_are() -> None:
    for sentence in ("a -- b", "x--y", "holds 2 labels", "say --landmarks FILE"):
        assert in_keywords(sentence) == sentence
    assert in_keywords("say --frame RAS where; --part (a, b)") == "say frame='RAS' where; part= (a, b)"


PAIRS = {name: (place, place) for name, place in zip("abcd", BALL.prior.vertices[::30], strict=False)}


@pytest.mark.parametrize(
    ("landmarks", "said"),
    [
        (dict(list(PAIRS.items())[:2]), "a, b are not used for the pose: three that are not on one line"),
        (
            {n: (np.full(3, k), np.full(3, k)) for k, n in enumerate("abc")},
            "a, b, c are not used .*: on one line",
        ),
        (PAIRS, ""),
        ({}, ""),
    ],
)
def test_landmarks_that_register_does_not_use_are_said(
    landmarks: dict[str, Any], said: str, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, "o3dls"):
        o3dls.register(BALL.prior, XYZ, landmarks=landmarks, stages=[Nudge()])
    lines = [r.getMessage() for r in caplog.records if r.getMessage().startswith("landmarks: ")]
    assert (len(lines) == 1 and re.search(said, lines[0]) is not None) if said else not lines


def test_what_is_shown_is_one_line() -> None:
    found = o3dls.register(BALL.prior, {**COLUMNS, "lat": BIPOLAR}, stages=[Nudge()], name="<b>")
    shown = [found, found.run, found.estimate, found.run.case, found.run.case.points, found.estimate.surface]
    shown.append(o3dls.Truth(BALL.prior, BALL.prior.vertices))
    for thing in shown:
        text = repr(thing)
        assert text.startswith(type(thing).__name__ + "(")
        assert "\n" not in text
        assert len(text) < 250
    assert (
        repr(found.estimate.surface)
        == f"Surface({len(BALL.prior.vertices)} vertices, {len(BALL.prior.faces)} faces)"
    )
    assert "40 eam; columns bipolar, lat" in repr(found.run.case)
    for thing in (found, found.run):
        page = thing._repr_html_()
        assert "&lt;b&gt;" in page
        assert "<b>" not in page
        assert page.count("<tr>") == 1 + len(found.run.estimates)
        assert page.count("<td>") % page.count("<th>") == 0
