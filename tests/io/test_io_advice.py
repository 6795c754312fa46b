"""What a refusal advises is done here: the command that it names is taken by the next one, and mends it."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from said import said_by

import o3dls
from o3dls.errors import InputError
from o3dls.geometry.surface import Surface
from o3dls.io.meshes.repair import closed_outward, sewn, stand_alone, welded
from o3dls.io.surfaces import read_surface_file, write_surface

nibabel = pytest.importorskip("nibabel")

AT = np.indices((44, 44, 44)) - 21.5
BALL = (AT**2).sum(axis=0) < 20.0**2
UNIT_CODES = {"m": "meter", "mm": "mm", "um": "micron"}
MM = {"m": 1000.0, "mm": 1.0, "um": 0.001, "cm": 10.0}


def ball_points(n: int = 60, around: float = 21.5, radius: float = 20.0) -> np.ndarray:
    """Points on the ball in LPS."""
    ways = np.random.default_rng(81_233).normal(size=(n, 3))
    return (around + radius * ways / np.linalg.norm(ways, axis=1)[:, None]) * [-1, -1, 1]


def table(path: Path, xyz: np.ndarray) -> Path:
    path.write_text("# units=mm\nx,y,z\n" + "".join(f"{x},{y},{z}\n" for x, y, z in xyz))
    return path


def nifti(path: Path, states: str, meant: str) -> Path:
    """The ball as labels whose header states other units than its numbers are in."""
    step = 1.0 / MM[meant]
    image = nibabel.Nifti1Image(BALL.astype(np.uint8), np.diag([step, step, step, 1.0]))
    image.header.set_xyzt_units(UNIT_CODES[states])
    nibabel.save(image, path)
    return path


def advised(said: str) -> list[str]:
    """The option that a sentence says first."""
    found = re.search(r"say (--[a-z-]+ \S+?)[,;:]", said)
    assert found, said
    return shlex.split(found[1])


@pytest.mark.parametrize(("states", "meant"), [("um", "mm"), ("m", "mm"), ("um", "m"), ("mm", "m")])
def test_units_of_a_header_that_cannot_be_meant_are_asked_about_at_every_door(
    states: str, meant: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "o3dls")
    path = nifti(tmp_path / "la.nii", states, meant)
    points = table(tmp_path / "points.csv", ball_points())
    openep = Path(study(tmp_path))
    doors: tuple[tuple[Any, ...], ...] = (
        ("convert", path, tmp_path / "la.ply"),
        ("init", tmp_path / "case", "--prior", path, "--points", points),
        ("import", openep, tmp_path / "imported", "--prior", path),
    )
    for door in doors:
        code, said = said_by(*door)
        assert code == 2, said
        assert f"states units {states}, by which it extends over" in said
        assert advised(said) == ["--units", meant]
        code, said = said_by(*door, *advised(said))
        assert code == 0, said
        assert f"--units {meant} overrules that" in said + caplog.text
    for file in ("la.ply", "imported/prior.ply"):
        assert o3dls.read_surface(tmp_path / file).volume == pytest.approx(BALL.sum(), rel=0.02)
    assert o3dls.read_case(tmp_path / "case").prior.volume == pytest.approx(BALL.sum(), rel=0.02)
    image = nibabel.load(path)
    with pytest.raises(InputError, match=rf"say units='{meant}', else units='{states}'"):
        o3dls.case_of(image, ball_points())
    if meant == "mm":
        case = o3dls.case_of(image, ball_points(), units="mm")
        assert case.prior.volume == pytest.approx(BALL.sum(), rel=0.02)


def study(folder: Path) -> Path:
    """Points in a file of OpenEP."""
    from o3dls.case import Points
    from o3dls.io.matlab import openep

    xyz = ball_points()
    surface = Surface(np.eye(4, 3) * 30, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))
    (folder / "study.mat").write_bytes(openep.encode(surface, Points(xyz, np.full(len(xyz), "eam"))))
    return folder / "study.mat"


def test_units_that_a_mesh_states_wrongly_are_overruled_only_where_they_cannot_be(tmp_path: Path) -> None:
    ball = read_surface_file(nifti(tmp_path / "la.nii", "mm", "mm")).surface
    write_surface(tmp_path / "small.ply", ball.with_vertices(ball.vertices / 10.0), units="mm")
    write_surface(tmp_path / "right.ply", ball, units="mm")
    code, said = said_by("convert", tmp_path / "small.ply", tmp_path / "a.ply", "--units", "cm")
    assert code == 0, said
    assert o3dls.read_surface(tmp_path / "a.ply").volume == pytest.approx(ball.volume, rel=1e-4)
    code, said = said_by("convert", tmp_path / "right.ply", tmp_path / "b.ply", "--units", "cm")
    assert code == 2
    assert "states units mm, and cm was given; omit --units" in said


def soup_of(surface: Surface, off: float, seed: int = 5) -> Surface:
    """Each triangle by itself, its corners a little off."""
    corners = surface.vertices[surface.faces].reshape(-1, 3)
    noise = np.random.default_rng(seed).uniform(-off / 2, off / 2, corners.shape)
    return Surface(corners + noise, np.arange(len(corners)).reshape(-1, 3))


@pytest.fixture(scope="module")
def coarse() -> Surface:
    """A closed ball of some hundred triangles."""
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh.create_sphere(20.0, 12)
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.triangles))


@pytest.mark.parametrize("off", [0.0, 1e-5, 1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("name", ["soup.stl", "soup.ply", "soup.vtp", "soup.obj"])
def test_a_soup_of_triangles_is_welded_and_never_capped(
    name: str, off: float, coarse: Surface, tmp_path: Path
) -> None:
    write_surface(tmp_path / name, soup_of(coarse, off), units="mm")
    for options in ((), ("--cap",)):
        code, said = said_by("convert", tmp_path / name, tmp_path / "out.ply", *options)
        assert code == 0, said
        found = o3dls.read_surface(tmp_path / "out.ply")
        assert len(found.faces) == len(coarse.faces)
        assert found.watertight
        assert found.volume == pytest.approx(coarse.volume, rel=1e-2)
    if off:
        assert "most triangles share no edge: vertices up to" in said
    closed = closed_outward(soup_of(coarse, off), "soup")
    assert len(closed.vertices) == len(coarse.vertices)


def test_a_seam_is_welded_and_an_opening_is_not(coarse: Surface) -> None:
    """Two halves whose rims are written a little apart, as some programs do at the ends of a texture."""
    upper = coarse.vertices[coarse.faces].mean(axis=1)[:, 0] > 0
    moved = coarse.vertices + np.array([1e-4, 0, 0])
    faces = np.concatenate([coarse.faces[upper], coarse.faces[~upper] + len(moved)])
    halves = Surface(np.concatenate([coarse.vertices, moved]), faces).without_unused()
    assert closed_outward(halves, "halves").volume == pytest.approx(coarse.volume, rel=1e-3)
    opened = Surface(coarse.vertices, coarse.faces[8:])
    assert sewn(welded(opened))[1] == 0.0
    with pytest.raises(InputError, match=r"is open \(\d+ edges have one triangle only\); close it with"):
        closed_outward(opened, "opened")


def test_what_is_advised_for_an_open_prior_closes_it(coarse: Surface, tmp_path: Path) -> None:
    write_surface(tmp_path / "prior.ply", Surface(coarse.vertices, coarse.faces[8:]), units="mm")
    points = table(tmp_path / "points.csv", ball_points(around=0.0))
    make = ("init", tmp_path / "case", "--points", points, "--prior")
    code, said = said_by(*make, tmp_path / "prior.ply")
    assert code == 2
    assert "o3dls convert --cap" in said
    assert said_by("convert", tmp_path / "prior.ply", tmp_path / "closed.ply", "--cap")[0] == 0
    assert said_by(*make, tmp_path / "closed.ply")[0] == 0


@pytest.mark.parametrize("scattered", [1.0, 5.0])
def test_triangles_that_nothing_joins_are_not_capped(scattered: float, coarse: Surface) -> None:
    soup = soup_of(coarse, scattered)
    assert stand_alone(soup) == 1.0
    with pytest.raises(InputError, match=r"most of its triangles share no edge .* repair the mesh first"):
        closed_outward(soup, "soup", cap=True)


def test_a_cap_that_encloses_nothing_is_refused() -> None:
    flat = Surface(
        np.array([[0.0, 0, 0], [40, 0, 0], [40, 40, 0], [0, 40, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
    )
    with pytest.raises(InputError, match="encloses nothing, even with its openings closed"):
        closed_outward(flat, "sheet", cap=True)


@pytest.mark.parametrize("farther", [0, 1])
def test_of_two_volumes_of_ensite_the_one_under_the_points_is_the_shell(
    farther: int, coarse: Surface, tmp_path: Path
) -> None:
    """`--part` is an option of the prior: no import could say it."""
    blocks = []
    for k, name in enumerate(("LA", "LAA")):
        at = coarse.vertices + (100.0 if k == farther else 0.0)
        rows = "\n".join(f"{x:.3f} {y:.3f} {z:.3f}" for x, y, z in at)
        corners = "\n".join(f"{a} {b} {c}" for a, b, c in coarse.faces + 1)
        blocks.append(
            f'<Volume name="{name}"><Vertices>\n{rows}</Vertices><Polygons>{corners}</Polygons></Volume>'
        )
    xml = f"<DIF><DIFHeader><Version>SJM_DIF_5.0</Version></DIFHeader><DIFBody><Volumes>{''.join(blocks)}"
    (tmp_path / "study").mkdir()
    (tmp_path / "study/DxLandmarkGeo.xml").write_text(f"{xml}</Volumes></DIFBody></DIF>")
    rows = "".join(f"{x},{y},{z},1\n" for x, y, z in ball_points(around=0.0))
    head = "Export File Version : 5.0\nMap name: m\nMap type: PP_bi\nroving x,roving y,roving z,utilized\n"
    (tmp_path / "study/Map_PP_bi.csv").write_text(f"{head}{rows}EOF\n")
    code, said = said_by("import", tmp_path / "study", tmp_path / "case")
    assert code == 0, said
    taken, left = ("LAA", "LA") if farther == 0 else ("LA", "LAA")
    assert f"shell DxLandmarkGeo.xml, volume {taken}, the nearest to the points" in said
    assert f"left DxLandmarkGeo.xml: volume {left}\n" in said
    assert np.abs(o3dls.read_surface(tmp_path / "case/map.ply").vertices).max() < 21.0


SHIFT, MIRROR = np.eye(4), np.diag([-1.0, 1, 1, 1])
SHIFT[:3, 3] = (50.0, 0, 0)
MIRROR[0, 3] = 43.0


@pytest.mark.parametrize(("other", "sentence"), [(SHIFT, "50 mm apart;"), (MIRROR, "one the mirror image")])
@pytest.mark.parametrize("name", ["la.nii", "la.nii.gz", "la.hdr"])
def test_two_forms_that_contradict_are_asked_about(
    name: str, other: np.ndarray, sentence: str, tmp_path: Path
) -> None:
    kind = nibabel.Nifti1Pair if name == "la.hdr" else nibabel.Nifti1Image
    image = kind(BALL.astype(np.uint8), np.eye(4))
    image.header.set_xyzt_units("mm")
    image.set_qform(other, code=1)
    image.set_sform(np.eye(4), code=2)
    nibabel.save(image, tmp_path / name)
    path, target = tmp_path / name, tmp_path / "la.ply"
    points = table(tmp_path / "points.csv", ball_points())
    for form, affine in (("sform", np.eye(4)), ("qform", other)):
        middle = (affine @ [21.5, 21.5, 21.5, 1.0])[:3] * [-1, -1, 1]
        for door in (
            ("convert", path, target),
            ("init", tmp_path / form, "--prior", path, "--points", points),
        ):
            code, said = said_by(*door)
            assert code == 2, said
            assert sentence in said
            assert "--form sform or --form qform" in said
            code, said = said_by(*door, "--form", form)
            assert code == 0, said
        prior = o3dls.read_case(tmp_path / form).prior
        for found in (o3dls.read_surface(target), prior, o3dls.surface_of(image, form=form)):
            np.testing.assert_allclose(found.vertices.mean(axis=0), middle, atol=0.1)
        target.unlink()


def test_forms_that_differ_by_rounding_agree_and_only_nifti_has_any(tmp_path: Path) -> None:
    image = nibabel.Nifti1Image(BALL.astype(np.uint8), np.eye(4))
    image.set_qform(np.eye(4), code=1)
    near = np.eye(4)
    near[:3, 3] = 0.4
    image.set_sform(near, code=1)
    nibabel.save(image, tmp_path / "la.nii")
    assert o3dls.read_surface(tmp_path / "la.nii").watertight
    write_surface(tmp_path / "la.ply", o3dls.read_surface(tmp_path / "la.nii"))
    code, said = said_by("convert", tmp_path / "la.ply", tmp_path / "b.ply", "--form", "qform")
    assert code == 2
    assert "'form' does not apply to a ply file" in said
    image.set_qform(np.eye(4), code=0)
    nibabel.save(image, tmp_path / "one.nii")
    code, said = said_by("convert", tmp_path / "one.nii", tmp_path / "b.ply", "--form", "qform")
    assert "its header has no qform: omit --form" in said
    assert said_by("convert", tmp_path / "one.nii", tmp_path / "b.ply")[0] == 0
