"""Points and case folders: equal after a round trip, refused with file, line and column where something
cannot be meant.
"""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
import tomllib
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from o3dls.case import POINT_TYPES, Case, Points, Truth
from o3dls.cli.main import answer
from o3dls.errors import InputError
from o3dls.geometry.surface import Surface, outline
from o3dls.io.atomic import check_free, staged_file, staged_folder
from o3dls.io.case_reader import read_case
from o3dls.io.case_settings import toml_lines
from o3dls.io.case_writer import write_case
from o3dls.io.manifest import write_manifest
from o3dls.io.meshes.repair import capped, closed_outward, welded
from o3dls.io.points import read_points, write_points
from o3dls.io.surfaces import write_surface
from o3dls.io.text import hashed_reads, read_bytes
from tests.tiny import ball_case

SEED = 738_112


def cube(size: float = 60.0) -> Surface:
    """A closed cube of 12 triangles, wound outward."""
    vertices = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float) * size
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Surface(vertices, np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]))


def points(n: int = 20) -> Points:
    rng = np.random.default_rng(SEED)
    kinds = np.array(["eam"] * (n - 3) + ["ablation", "inside", "landmark"])
    names = np.array([""] * (n - 1) + ["LSPV"])
    bipolar = np.where(np.arange(n) % 4 == 0, np.nan, np.abs(rng.normal(size=n)))
    sites = np.array([f"ridge {k}" for k in range(n)])
    return Points(rng.normal(size=(n, 3)) * 30, kinds, {"name": names, "bipolar": bipolar, "site": sites})


def case() -> Case:
    pose = np.array([[0.0, -1, 0, 3], [1, 0, 0, -4.5], [0, 0, 1, 5], [0, 0, 0, 1]])
    truth = Truth(
        cube(61.0),
        np.ones((4, 3)),
        np.array([True, False, True, False]),
        (np.zeros((2, 3)), np.ones((2, 3))),
        np.array([3, 5]),
    )
    return Case(
        "a case",
        cube(),
        points(),
        {"LSPV": np.array([1.0, 2, 3])},
        pose,
        frame="LPS",
        notes='say "so"',
        truth=truth,
    )


def same(a: Points, b: Points) -> None:
    np.testing.assert_array_equal(a.xyz, b.xyz)
    np.testing.assert_array_equal(a.type, b.type)
    assert list(a.columns) == list(b.columns)
    for name, values in a.columns.items():
        np.testing.assert_array_equal(values, b.columns[name])


def test_points_survive(tmp_path: Path) -> None:
    write_points(tmp_path / "p.csv", points(), space="LPS", units="mm")
    same(read_points(tmp_path / "p.csv"), points())


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    xyz=arrays(np.float64, (5, 3), elements=st.floats(-1e9, 1e9)),
    lat=arrays(np.float64, 5, elements=st.floats(-5e3, 5e3) | st.just(np.nan)),
    kinds=st.lists(st.sampled_from(POINT_TYPES), min_size=5, max_size=5),
    name=st.text("ab;,\"' \tµ#", max_size=8).map(str.strip),
)
def test_any_points_survive(
    xyz: np.ndarray, lat: np.ndarray, kinds: list[str], name: str, tmp_path: Path
) -> None:
    before = Points(xyz, np.array(kinds), {"lat": lat, "name": np.array([name] * 5)})
    write_points(tmp_path / "p.csv", before)
    same(read_points(tmp_path / "p.csv"), before)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_delimiters_aliases_and_comments(delimiter: str, tmp_path: Path) -> None:
    text = "# space=LPS units=mm\r\nX,Y,Z,kind,bip_mv\r\n1,2,3,ablation,0.5\r\n\r\n4,5,6,eam,\r\n".replace(
        ",", delimiter
    )
    (tmp_path / "p.csv").write_bytes(b"\xef\xbb\xbf" + text.encode())
    found = read_points(tmp_path / "p.csv")
    np.testing.assert_array_equal(found.xyz, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(found.type, ["ablation", "eam"])
    np.testing.assert_array_equal(found.columns["bipolar"], [0.5, np.nan])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("x,y\n1,2\n", "line 1: no column 'z'; there are: x, y"),
        ("x,y,z\n1,2,3\n1,zwei,3\n", "line 3, column 'y': 'zwei' is not a number"),
        ("x;y;z\n1.5;2,5;3\n", "line 2, column 'y': '2,5' has a decimal comma; write a decimal point"),
        ("x,y,z\n1,5,2,5,3\n", "line 2 has 5 cells, the header has 3; decimal commas"),
        ("x,y,z\n1,2,nan\n", "line 2, column 'z': 'nan' is not"),
        ("x,y,z\n1,2,inf\n", "'inf' is not finite"),
        ("x,y,z\n1,2,\n", "column 'z': '' is not a number"),
        ("x,y,z,bipolar\n1,2,3,high\n", "column 'bipolar': 'high' is not a number"),
        ("x,y,z,sigma\n1,2,3,\n1,2,4,0\n", "line 3, column 'sigma': a noise level must be above 0, not 0"),
        (
            "x,y,z,type\n1,2,3,abblation\n",
            "line 2, column 'type': 'abblation' is not a type of point: did you mean 'ablation'",
        ),
        ("x,y,z\n1,2,1_0\n", "line 2, column 'z': '1_0' is not a number"),
        ("x,y,z\n1,2,3\n# the end\n", "line 3 begins with #: comments belong above the header"),
        (
            "name,x,y,z\nA,1,2,3\n#B,4,5,6\n",
            "line 3 begins with #: .* a name that begins so stands in quotes",
        ),
        ("# space=scanner\nx,y,z\n1,2,3\n", "states space=scanner: must be one of LPS, RAS, unknown"),
        ("x,y,z,x\n1,2,3,4\n", "'x' appears twice"),
        ("x,y,z,\n1,2,3,4\n", "is empty"),
        ("x,y,z\n", "a header but no points"),
        ("# nothing\n", "no header line"),
        ('x,y,z,name\n1,2,3,"a\nb"\n', "quot"),
    ],
)
def test_wrong_points_are_named_by_line_and_column(text: str, sentence: str, tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(InputError, match=sentence) as error:
        read_points(tmp_path / "p.csv")
    assert "p.csv" in str(error.value)


def test_binary_points_are_refused(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_bytes(b"x,y,z\n\0\1\2")
    with pytest.raises(InputError, match="is binary"):
        read_points(tmp_path / "p.csv")


def test_case_survives(tmp_path: Path) -> None:
    write_case(tmp_path / "c", case())
    back = read_case(tmp_path / "c")
    assert (back.name, back.units, back.frame, back.notes) == ("a case", "mm", "LPS", 'say "so"')
    same(back.points, case().points)
    np.testing.assert_array_equal(back.prior.vertices, case().prior.vertices)
    np.testing.assert_array_equal(back.init, case().init)
    np.testing.assert_array_equal(back.prior_landmarks["LSPV"], [1, 2, 3])
    assert back.truth is not None
    assert back.truth.surface is not None
    np.testing.assert_array_equal(back.truth.unseen, [True, False, True, False])
    np.testing.assert_array_equal(back.truth.outliers, [3, 5])
    np.testing.assert_array_equal(back.truth.correspondence, case().truth.correspondence)
    assert len(back.files["prior.ply"]) == 64


def test_case_in_2d_survives(tmp_path: Path) -> None:
    ring = outline(np.array([[0.0, 0], [9, 0], [9, 7], [0, 7]]))
    flat = Points(np.random.default_rng(SEED).normal(size=(12, 2)), np.full(12, "eam"))
    write_case(
        tmp_path / "c", Case("flat", ring, flat, units="px", truth=Truth(ring, held_out=np.zeros((1, 2))))
    )
    back = read_case(tmp_path / "c")
    assert (back.dimension, back.units) == (2, "px")
    assert back.prior.volume == pytest.approx(63.0)


@pytest.mark.parametrize(("units", "factor"), [("m", 1000.0), ("cm", 10.0), ("um", 0.001), ("in", 25.4)])
def test_declared_units_become_millimetres(units: str, factor: float, tmp_path: Path) -> None:
    write_case(tmp_path / "c", case())
    folder = tmp_path / "c"
    (folder / "case.toml").write_text('frame = "unknown"\n')
    write_surface(folder / "prior.ply", cube(), units="unknown")
    write_surface(folder / "truth.ply", cube(), units="mm")  # a file that states its units is believed
    back = read_case(folder, units=units, frame="RAS")
    assert back.frame == "RAS"
    np.testing.assert_allclose(back.prior.vertices, cube().vertices * factor)
    np.testing.assert_allclose(back.points.xyz, points().xyz * factor)
    np.testing.assert_allclose(back.init[:3, 3], case().init[:3, 3] * factor)
    np.testing.assert_allclose(back.truth.surface.vertices, cube().vertices)


def test_every_file_of_a_case_is_in_the_units_that_it_states(tmp_path: Path) -> None:
    write_case(tmp_path / "c", case())
    for name in ("held_out.csv", "correspondence.csv", "prior_landmarks.csv", "points.csv"):
        path = tmp_path / "c" / name
        path.write_text("# Units=CM, space=lps\n" + path.read_text())
    back = read_case(tmp_path / "c")
    known = case()
    np.testing.assert_allclose(back.points.xyz, known.points.xyz * 10)
    np.testing.assert_allclose(back.truth.held_out, known.truth.held_out * 10)
    np.testing.assert_allclose(back.truth.correspondence, np.array(known.truth.correspondence) * 10)
    np.testing.assert_allclose(back.prior_landmarks["LSPV"], [10, 20, 30])
    write_surface(tmp_path / "c/prior.ply", cube(), units="inches")
    with pytest.raises(InputError, match=r"prior\.ply: states units 'inches': must be one of mm, cm"):
        read_case(tmp_path / "c")


def test_units_that_contradict_the_case_or_its_files_are_refused(tmp_path: Path) -> None:
    write_case(tmp_path / "c", case())
    with pytest.raises(InputError, match=r"case\.toml: states frame LPS, and --frame says RAS"):
        read_case(tmp_path / "c", frame="RAS")
    with pytest.raises(InputError, match=r"case\.toml: states units mm, and --units says px"):
        read_case(tmp_path / "c", units="px")
    (tmp_path / "c/case.toml").unlink()
    with pytest.raises(InputError, match="a file states units mm, and the case is in px"):
        read_case(tmp_path / "c", units="px")
    write_surface(tmp_path / "c/prior.ply", cube(), units="px")
    with pytest.raises(InputError, match="a file states units px, and the case is in mm"):
        read_case(tmp_path / "c", units="mm")


def test_files_of_one_name_in_two_folders_have_hashes_of_their_own(tmp_path: Path) -> None:
    write_case(tmp_path / "c", replace(case(), phases=(cube(61.0),)))
    (tmp_path / "c/phases/01.ply").rename(tmp_path / "c/phases/prior.ply")
    found = read_case(tmp_path / "c").files
    assert len({found["prior.ply"], found["phases/prior.ply"]}) == 2


def test_an_outline_is_in_the_units_that_it_states(tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text("dimension = 2\n")
    (tmp_path / "prior.csv").write_text("# units=cm\nx,y\n0,0\n6,0\n6,7\n0,7\n")
    (tmp_path / "points.csv").write_text("# units=cm\nx,y\n" + "1,2\n" * 12)
    back = read_case(tmp_path)
    assert back.prior.volume == pytest.approx(4200.0)
    np.testing.assert_array_equal(back.points.xyz, [[10, 20]] * 12)


def test_frames_are_known_words_and_agree(tmp_path: Path) -> None:
    write_case(tmp_path / "c", replace(case(), frame="unknown"))
    path = tmp_path / "c/points.csv"
    path.write_text("# space=ras, units=mm\n" + path.read_text())
    assert read_case(tmp_path / "c").frame == "RAS"
    with pytest.raises(
        InputError, match=r"points\.csv: states frame RAS, and --frame or case\.toml says LPS"
    ):
        read_case(tmp_path / "c", frame="LPS")
    write_surface(tmp_path / "c/prior.ply", cube(), space="RAS")
    path = tmp_path / "c/prior_landmarks.csv"
    path.write_text("# space=LPS\n" + path.read_text())
    np.testing.assert_array_equal(read_case(tmp_path / "c").prior_landmarks["LSPV"], [-1, -2, 3])


def test_files_for_evaluation_are_turned_into_the_frame_of_the_points(tmp_path: Path) -> None:
    write_case(tmp_path / "c", replace(case(), frame="RAS"))
    truth = read_case(tmp_path / "c").truth
    write_surface(tmp_path / "c/truth.ply", truth.surface, space="LPS")
    for name in ("held_out.csv", "correspondence.csv"):
        path = tmp_path / "c" / name
        path.write_text("# space=LPS\n" + path.read_text())
    turned = read_case(tmp_path / "c").truth
    np.testing.assert_array_equal(turned.surface.vertices, truth.surface.vertices * [-1, -1, 1])
    np.testing.assert_array_equal(turned.held_out, truth.held_out * [-1, -1, 1])
    np.testing.assert_array_equal(turned.correspondence[1], truth.correspondence[1] * [-1, -1, 1])
    # the prior's side; its frame is not stated
    np.testing.assert_array_equal(turned.correspondence[0], truth.correspondence[0])


def test_numbers_of_unknown_columns_keep_their_value_or_stay_text(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text(
        "x,y,z,id,code,depth\n1,2,3,12345678901234567,007,0.50\n4,5,6,12345678901234568,1_0,\n"
    )
    write_points(tmp_path / "q.csv", read_points(tmp_path / "p.csv"))
    columns = read_points(tmp_path / "q.csv").columns
    assert columns["id"].tolist() == ["12345678901234567", "12345678901234568"]
    assert columns["code"].tolist() == ["007", "1_0"]
    np.testing.assert_array_equal(columns["depth"], [0.5, np.nan])
    (tmp_path / "p.csv").write_text("x,y,z,impedance\n1,2,3,095\n4,5,6,110\n")
    np.testing.assert_array_equal(read_points(tmp_path / "p.csv").columns["impedance"], [95.0, 110.0])


def test_undeclared_metres_are_asked_about(tmp_path: Path) -> None:
    write_case(tmp_path / "c", case())
    (tmp_path / "c/case.toml").unlink()
    write_points(tmp_path / "c/points.csv", replace(points(), xyz=points().xyz / 1000))
    with pytest.raises(
        InputError, match=r"points.csv: extends over 0\.\d+ mm; if its units are m, say --units m"
    ):
        read_case(tmp_path / "c")
    write_points(tmp_path / "c/points.csv", points())
    write_surface(tmp_path / "c/prior.ply", cube(0.06), units="unknown")
    # edge of the cube: its diagonal is 1.7 times as long
    for size, unit in (
        (0.06, "m"),
        (2.0, "in"),
        (6.0, "cm"),
    ):
        write_surface(tmp_path / "c/prior.ply", cube(size), units="unknown")
        with pytest.raises(InputError, match=rf"prior\.ply: extends over .* say --units {unit}"):
            read_case(tmp_path / "c")


def test_a_case_in_code_is_in_millimetres_and_finite() -> None:
    with pytest.raises(InputError, match="units = 'm': lengths of a case are in mm or px"):
        replace(case(), units="m")
    with pytest.raises(InputError, match="point 2 is not finite"):
        replace(points(), xyz=np.where(np.arange(len(points()))[:, None] == 2, np.nan, points().xyz))


def test_a_force_that_cannot_be_is_refused(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("x,y,z,force\n1,2,3,-2.5\n4,5,6,\n7,8,9,-9000\n")
    with pytest.raises(
        InputError,
        match=r"p\.csv: line 4, column 'force': -9000 cannot .*within \[-100, 900\] g; leave it empty",
    ):
        read_points(tmp_path / "p.csv")


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("case.toml", "nmae = 'x'", "case.toml: nmae: no such key: did you mean 'name'"),
        ("case.toml", "name = 3", "name = 3: must be of type str"),
        ("case.toml", "units = 'inch'", "units = 'inch': must be one of mm, cm"),
        ("case.toml", "frame = 'lps'", "frame = 'lps': must be one of LPS"),
        ("case.toml", "name = ", "case.toml: Invalid value"),
        ("case.toml", "dimension = 2", "prior.ply: is 3D, the case is 2D"),
        ("case.toml", "prior = 'none.ply'", "prior = 'none.ply': no such file"),
        ("prior.stl", "solid", "both prior.ply and prior.stl"),
        (
            "prior_landmarks.csv",
            "name,x,y,z\nRSPV,1,2,3\n",
            r"no landmark of the points \(LSPV\) has its pair .* \(RSPV\)",
        ),
        (
            "prior_landmarks.csv",
            "name,x,y,z\nA,1,2,3\nA,1,2,3\n",
            "line 3, column 'name': 'A' appears twice",
        ),
        ("prior_landmarks.csv", "name,x,y\nA,1,2\n", "no column 'z'"),
        ("init.csv", "1,0,0\n0,1,0\n", "must hold 4 rows of 4"),
        ("init.csv", "1,0,0,0\n0,1,0,0\n0,0,-1,0\n0,0,0,1\n", "init.csv: is not a pose"),
        ("init.csv", "1,0.7,0,0\n0,1,0,0\n0,0,1,0\n0,0,0,1\n", "init.csv: is not a pose"),
        ("init.csv", "1,0,0,1_0\n0,1,0,0\n0,0,1,0\n0,0,0,1\n", "must hold 4 rows of 4"),
        ("outliers.csv", "row\n99\n", "outliers.csv names row 99: points have rows 0 to 19"),
        ("outliers.csv", "row\n0\n-1\n", "outliers.csv names row -1: points have rows 0 to 19"),
        ("outliers.csv", "row\n1.5\n", "outliers.csv: column 'row': 1.5 must be a whole number"),
        (
            "held_out.csv",
            "# units=inches\nx,y,z\n1,2,3\n",
            "held_out.csv: states units 'inches': must be one of mm, cm",
        ),
        ("held_out.csv", "x,y\n1,2\n", "held_out.csv: line 1: no column 'z'"),
        ("points.csv", "x,y,z\n" + "1,2,3\n" * 9, "9 points of type eam: at least 10"),
        ("points.csv", "", "points.csv: is empty"),
        ("prior.ply", "", "prior.ply: is empty"),
    ],
)
def test_wrong_cases_are_refused(name: str, text: str, sentence: str, tmp_path: Path) -> None:
    write_case(tmp_path / "c", case())
    (tmp_path / "c" / name).write_text(text)
    with pytest.raises(InputError, match=sentence):
        read_case(tmp_path / "c")


@pytest.mark.parametrize(
    ("name", "sentence"), [("prior.ply", "no prior surface"), ("points.csv", "no points.csv")]
)
def test_incomplete_cases_are_refused(name: str, sentence: str, tmp_path: Path) -> None:
    write_case(tmp_path / "c", case())
    (tmp_path / "c" / name).unlink()
    with pytest.raises(InputError, match=sentence):
        read_case(tmp_path / "c")
    with pytest.raises(InputError, match="no such case folder"):
        read_case(tmp_path / "none")


def test_open_priors_are_refused_or_capped(tmp_path: Path) -> None:
    box = cube()
    region = np.array([7.0, 2, 7, 4, 1, 1, 1, 1])
    opened = Surface(box.vertices, box.faces[2:], {"sd": np.arange(8.0) + 0.5, "region": region})
    write_case(tmp_path / "c", replace(case(), prior=opened, truth=replace(case().truth, surface=opened)))
    with pytest.raises(InputError, match=r"prior.ply: is open \(4 edges .* --cap.* cap = true"):
        read_case(tmp_path / "c")
    toml = tmp_path / "c/case.toml"
    toml.write_text(toml.read_text() + "cap = true\n")
    closed = read_case(tmp_path / "c").prior
    assert closed.watertight
    assert closed.volume == pytest.approx(box.volume)
    assert capped(opened).fields["sd"][-1] == pytest.approx(opened.fields["sd"][[0, 1, 2, 3]].mean())
    assert capped(opened).fields["region"][-1] == 7.0  # a label, of which there is no mean


def test_winding_is_mended_and_what_has_no_inside_is_refused() -> None:
    box = cube()
    rng = np.random.default_rng(SEED)
    turned = np.where(rng.random((12, 1)) < 0.4, box.faces[:, ::-1], box.faces)
    for faces in (box.faces[:, ::-1], turned):
        assert closed_outward(Surface(box.vertices, faces), "box").volume == pytest.approx(box.volume)
    soup = Surface(box.vertices[box.faces].reshape(-1, 3), np.arange(36).reshape(12, 3))
    assert closed_outward(soup, "soup").watertight
    assert len(welded(soup).vertices) == 8
    with pytest.raises(InputError, match="more than two triangles"):
        closed_outward(
            Surface(np.vstack([box.vertices, [[99, 99, 99]]]), np.vstack([box.faces, [[0, 1, 8]]])), "fin"
        )
    # five rungs; the last rung joins the first upside down
    upper, lower = (
        [0, 1, 2, 3, 4, 5],
        [5, 6, 7, 8, 9, 0],
    )
    strip = [
        f
        for k in range(5)
        for f in ((upper[k], upper[k + 1], lower[k]), (lower[k], upper[k + 1], lower[k + 1]))
    ]
    with pytest.raises(InputError, match="one-sided"):
        closed_outward(Surface(rng.normal(size=(10, 3)), np.array(strip)), "band")


def test_every_shared_case_is_read(shared_data: Path) -> None:
    folders = sorted(
        p.parent for kind in ("phantom", "real", "sim") for p in (shared_data / kind).glob("*/points.csv")
    )
    assert len(folders) >= 14
    for folder in folders:
        found = read_case(folder)
        assert found.prior.watertight, folder
        assert found.prior.volume > 0, folder
        assert found.truth is not None, folder
        assert len(found.points.of("eam")) > 30, folder


def fail_in(path: Path) -> None:
    path.write_text("half")
    raise RuntimeError("stop")


def test_staged_file_leaves_nothing_behind(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "a.txt"
    with staged_file(target) as staged:
        staged.write_text("one")
        assert not target.exists()
    with pytest.raises(RuntimeError, match="stop"), staged_file(target) as staged:
        fail_in(staged)
    assert target.read_text() == "one"
    assert [p.name for p in target.parent.iterdir()] == ["a.txt"]


def test_staged_folder_appears_whole_and_replaces_only_our_own(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with pytest.raises(RuntimeError, match="stop"), staged_folder(out) as staged:
        fail_in(staged / "run.json")
    assert list(tmp_path.iterdir()) == []
    with staged_folder(out) as staged:
        (staged / "run.json").write_text("{}")
    with pytest.raises(InputError, match="exists already"), staged_folder(out):
        pass
    with staged_folder(out, force=True) as staged:
        (staged / "other.txt").write_text("new")
    assert [p.name for p in out.iterdir()] == ["other.txt"]
    with pytest.raises(InputError, match="so o3dls does not replace it"), staged_folder(out, force=True):
        pass
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


@pytest.mark.parametrize(
    ("there", "new"),
    [("case.toml", "run.json"), ("run.json", "case.toml"), ("run.json", "paper_results.json")],
)
def test_a_folder_is_only_replaced_by_one_of_its_kind(there: str, new: str, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / there).write_text("")
    write_manifest(tmp_path / "out")
    with (
        pytest.raises(InputError, match="so o3dls does not replace it"),
        staged_folder(tmp_path / "out", force=True) as folder,
    ):
        (folder / new).write_text("")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {there, "manifest.txt"}


@pytest.mark.parametrize("read", ["out", "out/case"])
def test_a_folder_is_not_replaced_by_what_reads_it(read: str, tmp_path: Path) -> None:
    (tmp_path / "out" / "case").mkdir(parents=True)
    (tmp_path / "out" / "run.json").write_text("")
    # a run may lie in the folder of its case
    check_free(tmp_path / "out", True, "run", [tmp_path / "another", tmp_path])
    with pytest.raises(InputError, match=r"is or holds .*, which is read"):
        check_free(tmp_path / "out", True, "run", [tmp_path / read])


def test_a_place_that_cannot_be_written_is_named_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(
        InputError, match=r"run: cannot be made: .*file: Not a directory; name another folder"
    ):
        check_free(tmp_path / "file" / "run")
    check_free(tmp_path / "deep" / "run")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("name", ["a" * 255, "é" * 120 + ".run", "deep/" * 10 + "b" * 250])
def test_long_names_of_folders_and_files_are_written(name: str, tmp_path: Path) -> None:
    with staged_folder(tmp_path / name) as folder:
        (folder / "run.json").write_text("{}")
    assert (tmp_path / name / "run.json").is_file()
    with staged_file(tmp_path / "files" / name) as file:
        file.write_text("new")
    assert (tmp_path / "files" / name).read_text() == "new"


@pytest.mark.parametrize(
    "name", ["a" * 256, "é" * 130, "new/" + "b" * 300, "/".join(["c" * 200] * 20), "a\0b"]
)
def test_names_and_paths_that_are_too_long_are_named_before_any_work(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be"):
        check_free(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_path_with_no_room_for_the_files_of_a_run_is_named_before_any_work(tmp_path: Path) -> None:
    left = os.pathconf(tmp_path, "PC_PATH_MAX") - len(str(tmp_path)) - 150  # of the files of a run
    parts = ["c" * 200] * (left // 201) + ["d" * (left % 201)] * (left % 201 > 0)
    with pytest.raises(InputError, match=r"cannot be made: .*File name too long; name another folder"):
        check_free(tmp_path / "/".join(parts))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["loop", "one", "loop/run"])
def test_a_link_that_leads_to_itself_is_named_before_any_work(name: str, tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "one").symlink_to("other")
    (tmp_path / "other").symlink_to("one")
    with pytest.raises(InputError, match="is a link that leads to itself, or lies in one; name another"):
        check_free(tmp_path / name)
    with pytest.raises(InputError, match="is a link that leads to itself"), staged_file(tmp_path / name):
        pass


def test_an_old_folder_that_cannot_be_removed_does_not_spoil_the_new(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def kept(path: Path, ignore_errors: bool = False) -> None:
        if not ignore_errors:
            raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("shutil.rmtree", kept)
    for text in ("old", "new"):
        with staged_folder(tmp_path / "run", force=True) as folder:
            (folder / "run.json").write_text(text)
    assert (tmp_path / "run/run.json").read_text() == "new"
    assert "holds what was replaced, and cannot be removed: Permission denied" in caplog.text


def test_what_was_there_stays_where_the_new_folder_cannot_be_moved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with staged_folder(tmp_path / "run") as folder:
        (folder / "run.json").write_text("old")
    replaced = os.replace

    def only_the_old(source: Path, target: Path) -> None:
        if (source / "run.json").read_text() == "new":
            raise PermissionError(errno.EACCES, "Permission denied")
        replaced(source, target)

    monkeypatch.setattr("os.replace", only_the_old)
    with pytest.raises(PermissionError), staged_folder(tmp_path / "run", force=True) as folder:
        (folder / "run.json").write_text("new")
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    assert (tmp_path / "run/run.json").read_text() == "old"


def test_a_link_is_followed_and_stays(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    for name in ("file.txt", "folder", "dangling"):
        (tmp_path / name).symlink_to(tmp_path / "there" / f"real_{name}")
    (tmp_path / "there/real_folder").mkdir()
    with staged_file(tmp_path / "file.txt") as staged:
        assert staged.suffix == ".txt"
        staged.write_text("new")
    for name in ("folder", "dangling"):
        with staged_folder(tmp_path / name) as folder:
            (folder / "run.json").write_text("{}")
    assert all(path.is_symlink() for path in tmp_path.iterdir() if path.name != "there")
    assert (tmp_path / "there/real_file.txt").read_text() == "new"
    assert sorted(path.name for path in (tmp_path / "there").iterdir()) == [
        "real_dangling",
        "real_file.txt",
        "real_folder",
    ]


def test_a_pipe_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with (
        pytest.raises(InputError, match="pipe: is a pipe or a device; name a file"),
        staged_file(tmp_path / "pipe"),
    ):
        pass
    assert (tmp_path / "pipe").is_fifo()


def test_the_working_folder_is_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "run").mkdir()
    monkeypatch.chdir(tmp_path / "run")
    for name in (".", "..", tmp_path / "run"):
        with (
            pytest.raises(InputError, match="is the working folder, or holds it"),
            staged_folder(name, force=True),
        ):
            pass


def test_a_full_disk_is_said_with_the_name_of_the_file(tmp_path: Path) -> None:
    for staged in (staged_file, staged_folder):
        with (
            pytest.raises(InputError, match=r"a\.txt: cannot be written: No space left"),
            staged(tmp_path / "a.txt"),
        ):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["für 😀", "a\x7fb", 'a"b\\c\n', os.fsdecode(b"F\xfcr")])
def test_any_name_of_a_case_is_written_so_that_it_is_read(name: str, tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(toml_lines({"name": name}), encoding="utf-8")
    assert tomllib.loads(path.read_text(encoding="utf-8"))["name"] == name.replace("\udcfc", "?")


def test_a_killed_process_leaves_nothing_that_looks_finished(tmp_path: Path) -> None:
    code = (
        "import sys, time; from o3dls.io.atomic import staged_folder\n"
        "with staged_folder(sys.argv[1]) as f:\n (f / 'run.json').write_text('{}'); print('in', "
        "flush=True); time.sleep(60)"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "run")], stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"in\n"
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    process.stdout.close()
    time.sleep(0.01)
    assert not (tmp_path / "run").exists()
    assert all(p.name.startswith(".run.partial-") for p in tmp_path.iterdir())


def test_what_an_earlier_run_said_of_its_surface_is_not_taken_for_a_prior_s() -> None:
    values = np.zeros(4)
    stale = dict.fromkeys(
        ("sd_mm", "displacement_mm", "correction_mm", "distance_to_nearest_point_mm", "prior_only"), values
    )
    prior = Surface(
        np.vstack([np.zeros(3), np.eye(3)]),
        [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        stale | {"region": values},
    )
    case = Case("case", prior, Points(np.eye(3), np.full(3, "eam")))
    assert set(case.prior.fields) == {"region"}
    assert replace(case, units="px", prior=prior).prior.fields.keys() == stale.keys() - {"prior_only"} | {
        "region"
    }


def test_a_prior_wound_inwards_is_refused() -> None:
    prior = Surface(
        np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])[:, ::-1]
    )
    with pytest.raises(
        InputError, match="case case: the prior's faces are wound inwards: reverse the order of their corners"
    ):
        Case("case", prior, Points(np.eye(3), np.full(3, "eam")))


@pytest.mark.parametrize("header", [None, "x,y,z\n"])
def test_a_case_may_be_read_before_its_first_point(tmp_path: Path, header: str | None) -> None:
    write_case(tmp_path / "case", Case("new", cube(), Points(np.zeros((0, 3)), np.zeros(0, dtype=str))))
    (tmp_path / "case" / "points.csv").unlink()
    if header:
        (tmp_path / "case" / "points.csv").write_text(header, encoding="utf-8")
    assert len(read_case(tmp_path / "case", fewest=0).points) == 0
    with pytest.raises(InputError, match="points"):
        read_case(tmp_path / "case")


def test_the_hash_of_a_file_is_that_of_what_was_parsed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Somebody may write a file while it is read: the case says what it was made of."""
    write_case(tmp_path / "case", ball_case())
    parsed = {path.name: sha256(path.read_bytes()).hexdigest() for path in (tmp_path / "case").iterdir()}
    read = Path.read_bytes

    def then_changed(path: Path) -> bytes:
        data = read(path)
        path.write_bytes(data + b"\n")
        return data

    monkeypatch.setattr(Path, "read_bytes", then_changed)
    found = read_case(tmp_path / "case").files
    assert found
    assert found == {name: parsed[name] for name in found}


def test_a_file_that_changes_between_two_reads_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with hashed_reads():
        path.write_text("1")
        read_bytes(path)
        read_bytes(path)
        path.write_text("2")
        with pytest.raises(InputError, match="was changed while it was read"):
            read_bytes(path)
    assert read_bytes(path) == b"2"


@pytest.mark.parametrize("check", [True, False])
def test_a_landmark_without_a_pair_is_named(
    check: bool, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    case = ball_case()
    marks = {"z": np.array([0.0, 0.0, -20.0]), **case.prior_landmarks}
    del marks["c"]
    write_case(tmp_path / "ball", replace(case, prior_landmarks=marks))
    (tmp_path / "p.toml").write_text('case = "ball"\nout = "run"\nfolds = 0\n[[stage]]\nuse = "icp"\n')
    with caplog.at_level("INFO", "o3dls"):
        answer(["check" if check else "run", str(tmp_path / "p.toml")])
    said = [line for line in caplog.messages if "is not used" in line]
    assert len(said) == 2
    assert (
        "landmark c of the points is not used: it has no pair on the other side, which has z, a, b" in said[0]
    )
    assert (
        "landmark z of the prior is not used: it has no pair on the other side, which has a, b, c" in said[1]
    )
