"""Cases made in code are held to what files are: parts that do not fit together are refused where they are
made.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tiny import sphere

import o3dls
from o3dls import Landmarks, Pipeline, read_case
from o3dls.case import Case, Points
from o3dls.errors import InputError
from o3dls.geometry.similarity import is_pose, similarity
from o3dls.geometry.surface import Surface
from o3dls.io.case_writer import write_case
from o3dls.resources import demo_case
from o3dls.runs.run import record

XYZ = 20.0 * np.eye(3)
EAM = np.full(3, "eam")
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((XYZ, np.full(3, "eem")), "'eem' is not a type of point: did you mean 'eam'"),
        ((XYZ, EAM[:2]), r"column 'type' has shape \(2,\): there are 3 points"),
        ((XYZ, EAM, {"lat": np.zeros(4)}), r"column 'lat' has shape \(4,\)"),
        ((XYZ[0], EAM), r"must be \(n, 2\) or \(n, 3\)"),
    ],
)
def test_points_that_do_not_fit_together_are_refused(arguments: tuple[Any, ...], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Points(*arguments)


def test_points_may_be_lists() -> None:
    points = Points(XYZ.tolist(), ["eam"] * 3, {"lat": [1, 2, 3]})  # type: ignore[arg-type]
    assert points.of("eam").columns["lat"].tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"frame": "XYZ"}, "frame = 'XYZ': must be one of LPS, RAS, unknown"),
        ({"init": np.eye(3)}, "init is not a pose"),
        (
            {"prior_landmarks": {"LSPV": np.zeros(2)}},
            "landmark 'LSPV' of the prior is .*: must be 3 finite numbers",
        ),
        ({"prior_landmarks": {"LSPV": np.full(3, np.nan)}}, "must be 3 finite numbers"),
        ({"points": Points(XYZ, np.array(["eam", "eam", "landmark"]))}, "type landmark need a column 'name'"),
    ],
)
def test_a_case_that_no_file_could_hold_is_refused(options: dict[str, Any], sentence: str) -> None:
    prior = sphere()
    with pytest.raises(InputError, match=sentence):
        Case("case", **{"prior": prior, "points": Points(XYZ, EAM)} | options)


def test_a_pose_is_a_rotation_a_shift_and_one_scale() -> None:
    pose = similarity(TURN, np.array([10.0, -20.0, 30.0]), 1.1)
    assert is_pose(pose, 3)
    assert is_pose(np.round(similarity(TURN @ TURN, np.ones(3)), 2), 3)
    for k, value in (((0, 1), 0.7), ((3, 0), 1.0), ((2, 2), -1.0), ((0, 0), np.nan), ((1, 1), 1e300)):
        wrong = pose.copy()
        wrong[k] = value
        assert not is_pose(wrong, 3)
    assert not is_pose(np.zeros((4, 4)), 3)


def test_surfaces_name_what_does_not_fit() -> None:
    vertices, faces = sphere().vertices, sphere().faces
    for wrong, sentence in (
        (-1, "vertex -1: there are"),
        (len(vertices), f"vertex {len(vertices)}: there are"),
        (0.7, "vertex 0.7"),
    ):
        other = faces.astype(np.float64)
        other[3, 1] = wrong
        with pytest.raises(InputError, match=sentence):
            Surface(vertices, other)
    with pytest.raises(
        InputError, match=rf"field 'lat' has shape \(3,\): there are {len(vertices)} vertices"
    ):
        Surface(vertices, faces, {"lat": np.zeros(3)})


def test_landmarks_pair_where_their_names_mean_one_place() -> None:
    kinds = np.array(["landmark", "eam", "landmark", "landmark"])
    names = np.array(["left superior PV", "", "MV", "roof"])
    points = Points(np.vstack([XYZ, [[1.0, 2, 3]]]), kinds, {"name": names})
    prior = {"septum": XYZ[0], "MA": XYZ[1], "LSPV": XYZ[2]}
    case = Case("c", sphere(), points, prior)
    assert case.landmark_partners() == {0: "LSPV", 2: "MA"}
    found, on_prior, measured = case.landmark_pairs()
    assert found == ["left superior PV", "MV"]
    np.testing.assert_array_equal(on_prior, XYZ[[2, 1]])
    np.testing.assert_array_equal(measured, XYZ[[0, 2]])


def test_points_keep_their_order_when_some_are_left_out() -> None:
    points = Points(np.zeros((4, 3)), np.array(["eam", "ablation", "eam", "eam"]))
    np.testing.assert_array_equal(points.taken, [0.0, 1.0, 2.0, 3.0])
    np.testing.assert_array_equal(points.of("eam").taken, [0.0, 2.0, 3.0])
    np.testing.assert_array_equal(points.of("eam").select(np.array([True, False, True])).taken, [0.0, 3.0])
    with pytest.raises(InputError, match="'order' has shape"):
        Points(np.zeros((4, 3)), points.type, order=np.arange(3.0))


def test_whose_anatomy_the_prior_is_survives_every_way_in_and_out(tmp_path: Path) -> None:
    said = replace(read_case(demo_case()), prior_of="template")
    write_case(tmp_path / "case", said)
    assert read_case(tmp_path / "case").prior_of == said.visible().prior_of == "template"
    prior, points = said.prior, said.points.of("eam").xyz
    assert o3dls.case_of((prior.vertices, prior.faces), points).prior_of == "patient"
    assert o3dls.case_of((prior.vertices, prior.faces), points, prior_of="template").prior_of == "template"
    run = Pipeline([Landmarks()], folds=0).run(said)
    assert record(run).case.prior_of == "template"


@pytest.mark.parametrize("whose", ["mine", ""])
def test_another_owner_of_the_prior_is_refused_by_name(whose: str, tmp_path: Path) -> None:
    case = read_case(demo_case())
    with pytest.raises(InputError, match=f"prior_of = '{whose}': must be one of patient, template"):
        replace(case, prior_of=whose)
    with pytest.raises(InputError, match=f"prior_of = '{whose}': must be one of patient, template"):
        o3dls.case_of((case.prior.vertices, case.prior.faces), case.points.of("eam").xyz, prior_of=whose)
    write_case(tmp_path / "case", case)
    settings = tmp_path / "case" / "case.toml"
    settings.write_text(settings.read_text().replace('prior_of = "patient"', f'prior_of = "{whose}"'))
    with pytest.raises(InputError, match=r"case\.toml: prior_of = .*must be one of patient, template"):
        read_case(tmp_path / "case")
