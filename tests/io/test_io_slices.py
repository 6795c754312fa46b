"""Label volumes with thick slices: the surface lies where the chamber lies, keeps every label, and loses no
vein that shifts from slice to slice.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, label

from benchmarks.label_slices import compared, orientations, read_back, unsmoothed, voxelised
from o3dls.evaluation.distances import occupancy
from o3dls.evaluation.validity import components
from o3dls.geometry.surface import Surface
from o3dls.io.images.pieces import filled, joined
from o3dls.io.images.wall import mask_surface, parts_of
from o3dls.io.surfaces import read_surface, read_surface_file
from o3dls.runs.conversion import convert

SHIFT = np.array([0.3, 0.1, 0.45])  # of the voxels; any will do
# of one position: a vein between two slices is in no label, and how far a flat wall goes on is open
AT_WORST = 1.4


def affine_of(spacing: np.ndarray) -> np.ndarray:
    return np.diag([*spacing, 1.0])


def places(mask: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Centres (nz, ny, nx, 3) of the voxels of a mask whose first lies at 0."""
    return np.stack(np.indices(mask.shape)[::-1], axis=-1) * spacing


def ball(spacing: np.ndarray, radius: float = 22.0) -> np.ndarray:
    """In the middle of its volume."""
    counts = np.ceil((2 * radius + 8.0) / spacing).astype(int)[::-1]
    mask = np.zeros(counts, dtype=bool)
    centre = (counts[::-1] - 1) / 2 * spacing
    return np.asarray(np.linalg.norm(places(mask, spacing) - centre, axis=-1) < radius)


@pytest.fixture(scope="module")
def atrium(shared_data: Path) -> Surface:
    return read_surface(shared_data / "real/kit_mri_to_eam/prior.ply")


@pytest.mark.parametrize(("thickness", "most"), [(5.0, 0.4), (8.0, 0.6), (10.0, 0.8)])
def test_thick_slices_neither_shrink_nor_step_an_atrium(
    thickness: float, most: float, atrium: Surface
) -> None:
    found, plain = [], []
    for turn in orientations()[:4]:
        volume = voxelised(atrium, np.array([1.25, 1.25, thickness]), turn, SHIFT)
        surface = read_back(*volume)
        assert surface.watertight
        assert components(surface) == 1
        found.append(compared(surface, atrium))
        plain.append(compared(unsmoothed(*volume), atrium))
    (volumes, gaps), without = np.array(found).T, np.array(plain)[:, 1]
    print(f"{thickness} mm: volume {np.round(100 * volumes, 1)} %, distance {gaps.round(2)} mm,", end=" ")
    print(f"unsmoothed {without.round(2)} mm")
    assert abs(volumes.mean()) < 0.02
    assert np.abs(volumes).max() < 0.03
    assert gaps.mean() < most
    assert gaps.max() < AT_WORST * most
    assert (gaps < without).all()


@pytest.mark.parametrize("spacing", [1.0, 3.0])
def test_even_voxels_are_no_worse_than_by_a_blur(spacing: float, atrium: Surface) -> None:
    mask, affine = voxelised(atrium, np.full(3, spacing), orientations()[3], SHIFT)
    blurred = gaussian_filter(np.pad(mask, 3).astype(float), 0.6)
    off, gap = compared(read_back(mask, affine), atrium)
    before_off, before = compared(half_way(blurred, affine), atrium)
    assert gap < before
    assert abs(off) < abs(before_off)
    assert gap < compared(unsmoothed(mask, affine), atrium)[1]


def half_way(values: np.ndarray, affine: np.ndarray) -> Surface:
    import open3d as o3d

    mesh = o3d.t.geometry.TriangleMesh.create_isosurfaces(
        o3d.core.Tensor.from_numpy(values.astype(np.float32)), [0.5]
    )
    indices = mesh.vertex.positions.numpy() - 3.0
    return Surface(indices, mesh.triangle.indices.numpy()).transformed(affine)


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 8.0), (0.8, 6.0, 1.0), (5.0, 1.2, 1.0), (1.0, 1.0, 1.0)])
def test_the_wall_passes_no_centre_of_a_voxel(spacing: tuple[float, float, float]) -> None:
    """Also where every third voxel of the rim is wrong, and whichever axis the slices lie along."""
    h = np.array(spacing)
    mask = ball(h)
    rim = mask & (np.indices(mask.shape).sum(axis=0) % 3 == 0)
    mask &= ~(rim & (gaussian_filter(mask.astype(float), 0.5) < 0.8))
    mask = read_largest(mask)
    surface = mask_surface(mask, affine_of(h))
    axes = [step * np.arange(n) for step, n in zip(h, mask.shape[::-1], strict=True)]
    kept = filled(np.pad(mask, 1))[1:-1, 1:-1, 1:-1]  # but for small holes
    np.testing.assert_array_equal(occupancy(surface, axes).transpose(2, 1, 0), kept)
    assert surface.volume == pytest.approx(mask.sum() * h.prod(), rel=0.03)


def read_largest(mask: np.ndarray) -> np.ndarray:
    return joined(mask, np.ones(3))[0]


def test_a_ball_is_found_the_better_the_thinner_its_slices() -> None:
    gaps = []
    for thickness in (10.0, 5.0, 2.5):
        h = np.array([1.0, 1.0, thickness])
        mask = ball(h)
        surface = mask_surface(mask, affine_of(h))
        centre = (np.array(mask.shape[::-1]) - 1) / 2 * h
        off = np.linalg.norm(surface.vertices - centre, axis=1) - 22.0
        gaps.append(np.abs(off).mean())
        assert abs(off.mean()) < 0.05 * thickness  # no bulge, no dent
    assert gaps[0] < 0.35
    assert gaps[2] < gaps[1] < gaps[0]


def test_what_the_volume_cuts_off_ends_in_a_flat_cap() -> None:
    h = np.array([1.0, 1.0, 8.0])
    mask = ball(h, 40.0)
    mask = mask[: len(mask) // 2]
    surface = mask_surface(mask, affine_of(h))
    assert surface.watertight
    end = (len(mask) - 0.5) * h[2]  # half a voxel past the last centre
    heights = surface.vertices[:, 2]
    assert heights.max() == pytest.approx(end, abs=0.5)
    middle = np.linalg.norm(surface.vertices[:, :2] - (np.array(mask.shape[:0:-1]) - 1) / 2, axis=1) < 12.0
    np.testing.assert_allclose(heights[middle & (heights > end - 3.0)], end, atol=0.3)


def test_a_volume_cut_out_around_its_label_cuts_nothing_off() -> None:
    h = np.array([1.0, 1.0, 8.0])
    mask = ball(h)
    first, last = (np.array([ends(axis) for axis in np.nonzero(mask)]) for ends in (np.min, np.max))
    inner = mask_surface(mask[tuple(map(slice, first, last + 1))], affine_of(h))
    np.testing.assert_allclose(
        inner.vertices + first[::-1] * h, mask_surface(mask, affine_of(h)).vertices, atol=1e-6
    )


H = np.array([1.0, 1.0, 8.0])
VEIN = 58.0  # degrees: its sections shift by 13 mm and are 9 mm long


def with_vein(width: float, degrees: float, length: float = 60.0) -> np.ndarray:
    """A ball with a tube that rises from its middle, `degrees` from the normal of the slices."""
    mask = np.zeros((14, 70, 140), dtype=bool)
    offset = places(mask, H) - [35.0, 35.0, 28.0]
    way = np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])
    along = np.clip(offset @ way, 0.0, length)
    tube = np.linalg.norm(offset - along[..., None] * way, axis=-1) < width / 2
    return np.asarray(tube | (np.linalg.norm(offset, axis=-1) < 20.0))


def test_a_vein_whose_sections_do_not_overlap_stays_on_the_chamber(tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    mask = with_vein(5.0, VEIN)
    assert label(mask)[1] >= 3  # nothing else keeps its sections together
    image = sitk.GetImageFromArray(mask.astype(np.uint8))
    image.SetSpacing(H)
    sitk.WriteImage(image, str(tmp_path / "a.nrrd"))
    file = read_surface_file(tmp_path / "a.nrrd")
    end = np.array([35.0, 35.0, 28.0]) + 60.0 * np.array(
        [np.sin(np.radians(VEIN)), 0, np.cos(np.radians(VEIN))]
    )
    assert np.linalg.norm(file.surface.vertices - end, axis=1).min() < H[2]
    assert components(file.surface) == 1
    assert file.surface.watertight
    assert file.metadata["voxels_of_smaller_pieces"] == 0
    said = "2 thin pieces that only the gap between two slices parts are joined to the chamber"
    assert file.notes == (said,)
    assert f"{tmp_path / 'a.nrrd'}: {said}" in convert(tmp_path / "a.nrrd", tmp_path / "a.ply")


@pytest.mark.parametrize(
    ("piece", "taken"),
    [
        ((slice(7, 8), slice(48, 54), slice(72, 78)), True),  # goes on from the edge of the last slice
        ((slice(7, 9), slice(30, 70), slice(72, 100)), False),  # wide: another chamber
        ((slice(7, 8), slice(50, 51), slice(72, 76)), False),  # dust
        ((slice(4, 7), slice(48, 54), slice(72, 78)), False),  # beside the chamber in its own slices
        ((slice(7, 8), slice(48, 54), slice(78, 84)), False),  # too far away
        ((slice(8, 9), slice(48, 54), slice(60, 66)), False),  # a slice between is empty
    ],
)
def test_only_what_may_be_a_vein_is_joined(piece: tuple[slice, slice, slice], taken: bool) -> None:
    mask = np.zeros((10, 100, 100), dtype=bool)
    mask[2:7, 30:70, 30:70] = True
    mask[piece] = True
    body, bridges = joined(mask, H[::-1])
    assert body[piece].all() == taken
    assert body[piece].any() == taken
    assert len(bridges) == taken
    assert not joined(mask, np.ones(3))[1]  # only where slices are thick


def test_small_holes_are_filled_and_a_cavity_is_kept() -> None:
    h = np.array([1.0, 1.0, 5.0])
    mask = ball(h)
    middle = tuple(n // 2 for n in mask.shape)
    mask[middle] = False
    assert components(mask_surface(mask, affine_of(h))) == 1
    mask[middle[0], middle[1] - 5 : middle[1] + 5, middle[2] - 5 : middle[2] + 5] = False
    assert components(mask_surface(mask, affine_of(h))) == 2


def test_time_and_memory_are_those_of_the_label_not_of_the_volume() -> None:
    h = np.array([0.7, 0.7, 5.0])
    chamber = ball(h, 35.0)
    mask = np.zeros((40, 512, 512), dtype=bool)
    mask[10 : 10 + chamber.shape[0], 200 : 200 + chamber.shape[1], 200 : 200 + chamber.shape[2]] = chamber
    mask[0, 0, 0] = True  # dust far away
    start = time.process_time()
    surface = read_back(mask, affine_of(h))
    assert time.process_time() - start < 10.0  # about 1 s
    assert surface.volume == pytest.approx(4 / 3 * np.pi * 35.0**3, rel=0.02)
    assert parts_of(chamber, h[::-1]) == 7
    assert parts_of(mask, h[::-1]) == 3  # a label as large as the volume
    assert parts_of(mask, np.array([1.5, 0.7, 0.7])) == 1  # its voxels are small enough as they are
    assert parts_of(chamber, np.array([1.5, 0.7, 0.7])) == 3
