"""A label that is not the chamber, or of which most would be left out, is refused with the reason and a way
on; each way on is taken here.
"""

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
from o3dls.evaluation.interpolation import REACH
from o3dls.geometry.cut_wall import on_cut
from o3dls.geometry.shells import wall_thickness
from o3dls.geometry.surface import Surface
from o3dls.io.images.labels import surface_of
from o3dls.io.images.voxels import Image
from o3dls.io.surfaces import read_surface, write_surface
from o3dls.pipeline.pipeline import Pipeline
from o3dls.report.grading.wall import prior_only
from o3dls.report.subject import read_subject
from tests.finished import Icp

nibabel = pytest.importorskip("nibabel")

N = 40
AFFINES = {
    "straight": np.diag([1.0, 1, 1, 1]),
    "thick": np.diag([1.0, 1, 2.5, 1]),
    "mirrored": np.array([[-1.2, 0, 0, 40], [0, 1, 0, -9], [0, 0, 1, 7], [0, 0, 0, 1]]),
    "oblique": np.array([[0.8, -0.6, 0, 3], [0.6, 0.8, 0, -20], [0, 0, 1, 5], [0, 0, 0, 1.0]]),
}


def ball(radius: float = 14.0, centre: float = 19.5, n: int = N) -> np.ndarray:
    at = np.indices((n, n, n)) - centre
    return (at**2).sum(axis=0) < radius**2


def seen(mask: np.ndarray, affine: np.ndarray = AFFINES["straight"], **choice: Any) -> Any:
    return surface_of(Image(mask.astype(np.uint8), affine), "la.nii", **choice)


def saved(labels: np.ndarray, path: Path) -> Path:
    """Labels (z, y, x) as a NIfTI of millimetres."""
    image = nibabel.Nifti1Image(labels.astype(np.uint8).transpose(2, 1, 0), np.eye(4))
    image.header.set_xyzt_units("mm")
    nibabel.save(image, path)
    return path


def followed(source: Path, target: Path, *given: str) -> Surface:
    """The surface that `convert` writes once it gets the options that its refusal names."""
    code, said = said_by("convert", source, target, *given)
    assert code == 2, said
    assert not target.exists()
    option = re.search(r"--(?:fill-slices|box(?: -?[\d.]+){6})", said)
    assert option, said
    code, said = said_by("convert", source, target, *given, *shlex.split(option[0]))
    assert code == 0, said
    return read_surface(target)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("blank", [[19], [12, 20, 21], [k for k in range(N) if k % 3]])
def test_blank_slices_are_named_and_interpolated_where_that_is_said(
    axis: int, blank: list[int], tmp_path: Path
) -> None:
    whole = ball()
    mask = whole.copy()
    mask.swapaxes(0, axis)[blank] = False
    path = saved(mask, tmp_path / "la.nii.gz")
    with pytest.raises(InputError, match=r"holds \d+% of its \d+ voxels .*blank slices lie within it"):
        o3dls.read_surface(path)
    assert followed(path, tmp_path / "la.ply").volume == pytest.approx(whole.sum(), rel=0.05)
    case = o3dls.case_of(nibabel.load(path), ball_points(), fill_slices=True)
    assert case.prior.volume == pytest.approx(whole.sum(), rel=0.05)


def ball_points() -> np.ndarray:
    """Points on the ball in the LPS of its NIfTI."""
    ways = np.random.default_rng(20_911).normal(size=(60, 3))
    return (19.5 + 14.0 * ways / np.linalg.norm(ways, axis=1)[:, None]) * [-1, -1, 1]


def test_a_case_may_fill_its_slices(tmp_path: Path) -> None:
    mask = ball()
    mask[20] = False
    path = saved(mask, tmp_path / "la.nii")
    rows = "".join(f"{x},{y},{z}\n" for x, y, z in ball_points())
    (tmp_path / "points.csv").write_text("# space=LPS units=mm\nx,y,z\n" + rows)
    make = ("init", tmp_path / "case", "--prior", path, "--points", tmp_path / "points.csv")
    assert said_by(*make)[0] == 2
    code, said = said_by(*make, "--fill-slices")
    assert code == 0, said
    assert "fill_slices = true" in (tmp_path / "case" / "case.toml").read_text()
    assert o3dls.read_case(tmp_path / "case").prior.volume == pytest.approx(ball().sum(), rel=0.02)


def test_a_blank_slice_near_the_end_is_said() -> None:
    mask = ball()
    mask[9] = False
    notes = " ".join(seen(mask).notes)
    assert re.search(r"voxels of smaller pieces are left out, \d\.\d% of the label", notes)
    assert "1 blank slices lie within it; --fill-slices interpolates them" in notes
    assert "1 blank slices within it are interpolated" in " ".join(seen(mask, fill_slices=True).notes)


@pytest.mark.parametrize("affine", AFFINES.values(), ids=AFFINES)
def test_of_several_pieces_the_largest_is_taken_by_the_box_that_is_named(
    affine: np.ndarray, tmp_path: Path
) -> None:
    alone = ball(9.0, 10.0)
    mask = alone | ball(8.0, 29.0)
    with pytest.raises(InputError, match=r"59% of its \d+ voxels .*cut to it with --box") as refused:
        seen(mask, affine)
    box = tuple(map(float, re.findall(r"-?[\d.]+", str(refused.value).split("--box")[1])))[:6]
    found = seen(mask, affine, box=box)
    np.testing.assert_array_equal(found.surface.vertices, seen(alone, affine).surface.vertices)
    if affine is AFFINES["straight"]:
        surface = followed(saved(mask, tmp_path / "la.nii"), tmp_path / "la.ply")
        assert surface.volume == pytest.approx(alone.sum(), rel=0.02)


def test_pieces_that_no_box_parts_are_refused() -> None:
    tangled = np.zeros((N, N, N), dtype=bool)
    tangled[4:36, 4:36, 4:8] = tangled[4:8, 4:36, 4:36] = True
    tangled[12:36, 4:36, 14:20] = True
    with pytest.raises(InputError, match=r"62% .* the others lie around it; join them, or save the chamber"):
        seen(tangled)


def test_an_outline_is_no_chamber() -> None:
    """A closed one is a wall; one that is drawn slice by slice falls apart where the wall leans."""
    closed = ball() & ~ball(12.5)
    assert any("encloses a wall 1." in note for note in (*seen(closed).notes, note_of(seen(closed).surface)))
    dashed = ball(17.0) & ~ball(16.0)
    dashed[::4] = False
    with pytest.raises(InputError, match="it is an outline, within which"):
        seen(dashed)


def test_an_inverted_mask_is_refused_and_read_by_the_label_that_is_named(tmp_path: Path) -> None:
    path = saved(~ball(), tmp_path / "la.nii.gz")
    with pytest.raises(
        InputError, match=r"label 1 covers 100% of the outermost .* inverted; .*--label \(0\)"
    ):
        o3dls.read_surface(path)
    code, said = said_by("convert", path, tmp_path / "la.ply", "--label", 0)
    assert code == 0, said
    assert read_surface(tmp_path / "la.ply").volume == pytest.approx(ball().sum(), rel=0.02)


def test_a_background_that_is_a_label_is_refused() -> None:
    labels = np.where(ball(), 3, np.where(np.indices((N, N, N))[0] < 2, 0, 1))
    with pytest.raises(InputError, match=r"label 1 covers 8\d% .* background.*--label \(0, 3\)"):
        surface_of(Image(labels, np.eye(4)), "la.nii", label=1)
    assert surface_of(Image(labels, np.eye(4)), "la.nii", label=3).surface.watertight


def test_a_volume_cut_out_around_the_chamber_is_no_background() -> None:
    used = np.nonzero(ball())
    tight = ball()[tuple(slice(axis.min(), axis.max() + 1) for axis in used)]
    assert seen(tight).surface.volume == pytest.approx(ball().sum(), rel=0.02)
    assert not seen(tight).notes


@pytest.mark.parametrize("channels", [1, 2, 4])
def test_a_first_axis_of_channels_is_named_and_moved_as_it_says(channels: int) -> None:
    one_hot = np.stack([ball().astype(np.uint8)] + [np.zeros((N, N, N), np.uint8)] * (channels - 1))
    with pytest.raises(InputError, match=rf"has {channels} x 40 x 40 x 40 voxels: .*numpy.moveaxis"):
        o3dls.surface_of(nibabel.Nifti1Image(one_hot, np.eye(4)))
    moved = np.moveaxis(one_hot, 0, -1)
    file = o3dls.surface_of(nibabel.Nifti1Image(moved, np.eye(4)), label=1)
    assert file.volume == pytest.approx(ball().sum(), rel=0.02)


@pytest.mark.parametrize(("cut", "borders"), [((slice(20, None),), 1), ((slice(0, 25), slice(15, None)), 2)])
def test_a_label_that_the_border_cuts_off_is_said_to_end_in_flat_caps(
    cut: tuple[slice, ...], borders: int
) -> None:
    mask = ball()[cut]
    (note,) = seen(mask).notes
    ends = [mask[0], mask[-1], mask[:, 0]][:: 2 if borders == 1 else 1]
    area = sum(end.sum() for end in ends)
    assert f"cuts the label off: {area / 100:.1f} cm² of its surface are flat caps" in note


@pytest.mark.parametrize("name", AFFINES)
@pytest.mark.parametrize(("cut", "borders"), [((slice(20, None),), 1), ((slice(0, 25), slice(15, None)), 2)])
def test_flat_caps_are_a_field_of_the_vertices(cut: tuple[slice, ...], borders: int, name: str) -> None:
    mask, affine = ball()[cut], AFFINES[name]
    surface = seen(mask, affine).surface
    caps = on_cut(surface)
    at = (surface.vertices - affine[:3, 3]) @ np.linalg.inv(affine[:3, :3]).T
    planes = [at[:, 2] + 0.5] if borders == 1 else [at[:, 2] - 24.5, at[:, 1] + 0.5]
    past = np.min(np.abs(planes), axis=0)
    assert past[caps].max() < 0.3
    assert caps[past < 0.01].all()
    sides = affine[:3, :3].T
    areas = [np.linalg.norm(np.cross(sides[0], sides[k])) for k in (1, 2)]
    ends = [mask[0].sum()] if borders == 1 else [mask[-1].sum(), mask[:, 0].sum()]
    expected = float(np.dot(areas[:borders], ends))
    assert surface.vertex_areas[caps].sum() == pytest.approx(expected, rel=0.15)


def test_no_wall_is_marked_where_no_border_cuts() -> None:
    assert not on_cut(seen(ball()).surface).any()


def test_flat_caps_are_prior_only_and_no_point_is_expected_there(tmp_path: Path) -> None:
    """Though points lie near: the catheter is in front of the cap, where there is no wall."""
    nibabel.save(nibabel.Nifti1Image(ball()[20:].astype(np.uint8), np.eye(4)), tmp_path / "la.nii")
    assert said_by("convert", tmp_path / "la.nii", tmp_path / "la.ply")[0] == 0
    prior = read_surface(tmp_path / "la.ply")
    assert on_cut(prior).any()  # as a case is written, and read again
    xyz = prior.vertices[:: len(prior.vertices) // 400]
    run = Pipeline([Icp()], folds=0).run(o3dls.case_of(prior, xyz))
    folder = run.write(tmp_path / "run")
    subject = read_subject([folder])
    surface = subject.last.estimate.surface
    share = surface.vertex_areas @ on_cut(surface) / surface.area
    assert 0.2 < share < 0.4
    assert (surface.fields["distance_to_nearest_point_mm"] < REACH).all()
    np.testing.assert_array_equal(surface.fields["prior_only"] > 0, on_cut(surface))
    assert subject.unmapped == pytest.approx(share)
    check = prior_only(subject)
    assert check.short == f"{share:.0%}"
    assert f"{share:.1%} is the cap where the border of the image cut the chamber off" in check.said


def test_the_wall_of_a_chamber_is_told_from_a_chamber() -> None:
    at = np.indices((64, 64, 64)) - 31.5
    size = np.sqrt((at**2).sum(axis=0))
    for thickness in (2.0, 3.5, 5.0):
        wall = (size < 28) & (size >= 28 - thickness)
        wall[:20] &= np.abs(at[1:, :20]).max(axis=0) > 9  # the valve is open, or not
        note = " ".join(seen(wall).notes)
        found = float(re.search(r"encloses a wall ([\d.]+) thick", note_of(seen(wall).surface) + note)[1])
        assert found == pytest.approx(thickness, abs=0.8)


def note_of(surface: Surface) -> str:
    thickness = wall_thickness(surface)
    return f"encloses a wall {thickness:.2g} thick" if thickness else ""


def shells(inward: bool) -> Surface:
    """An inner and an outer ball as two closed layers."""
    outer, inner = (seen(ball(radius)).surface for radius in (17.0, 14.5))
    faces = inner.faces[:, ::-1] if inward else inner.faces
    both = np.concatenate([outer.vertices, inner.vertices])
    return Surface(both, np.concatenate([outer.faces, faces + len(outer.vertices)]))


@pytest.mark.parametrize("inward", [True, False])
def test_two_layers_are_no_prior(inward: bool, tmp_path: Path) -> None:
    write_surface(tmp_path / "prior.ply", shells(inward))
    rows = "".join(f"{x},{y},{z}\n" for x, y, z in ball_points() * [-1, -1, 1])
    (tmp_path / "points.csv").write_text("x,y,z\n" + rows)
    given = ("--prior", tmp_path / "prior.ply", "--points", tmp_path / "points.csv")
    code, said = said_by("init", tmp_path / "case", *given)
    assert code == 2
    assert "encloses a wall 2." in said if inward else "components overlap" in said
    code, said = said_by("convert", tmp_path / "prior.ply", tmp_path / "a.vtp")
    assert code == 0
    assert ("encloses a wall 2." in said) is inward


@pytest.mark.parametrize("radius", [14.0, 6.0])
def test_a_chamber_with_the_steps_of_its_voxels_is_no_wall(radius: float) -> None:
    """Marching cubes without smoothing: normals differ from corner to corner."""
    import open3d as o3d

    at = np.indices((70, 40, 40)) - np.array([35, 19.5, 19.5])[:, None, None, None]
    tube = np.sqrt((at[1:] ** 2).sum(axis=0)) < radius / 2.0
    mask = ball_in(at, radius) | (tube & (np.abs(at[0]) < 30))
    field = np.where(mask, -1.0, 1.0).astype(np.float32)
    mesh = o3d.t.geometry.TriangleMesh.create_isosurfaces(o3d.core.Tensor.from_numpy(field), [0.0])
    surface = Surface(mesh.vertex.positions.numpy(), mesh.triangle.indices.numpy())
    assert surface.watertight
    assert wall_thickness(surface) == 0.0


def ball_in(at: np.ndarray, radius: float) -> np.ndarray:
    return (at**2).sum(axis=0) < radius**2
