"""Label volumes become surfaces that lie where the chamber lies: sub-voxel, closed, in any orientation."""

from __future__ import annotations

import gzip
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from o3dls.errors import InputError
from o3dls.io.case_reader import read_case
from o3dls.io.images.labels import surface_of
from o3dls.io.images.voxels import Image, whole_values
from o3dls.io.surfaces import read_surface_file
from o3dls.runs.conversion import convert

sitk = pytest.importorskip("SimpleITK", reason="label volumes need SimpleITK: pip install 'o3dls[images]'")

SPACING = np.array([0.78, 0.78, 1.5])
SHAPE = np.array([100, 100, 60])
SEED = 40_417
WITHIN = 0.25  # mm, mean distance from the truth


def turned() -> np.ndarray:
    return np.asarray(np.linalg.qr(np.random.default_rng(SEED).normal(size=(3, 3)))[0])


class Chamber:
    """A ball of 22 mm with three tubes of 5.5 mm, in a volume that lies obliquely; signed distance, negative
    inside.
    """

    def __init__(self, direction: np.ndarray) -> None:
        self.direction = direction
        self.origin = np.array([-40.0, 20, 10])
        self.centre = direction @ (SHAPE / 2 * SPACING) + self.origin

    def __call__(self, points: np.ndarray) -> np.ndarray:
        local = (points - self.centre) @ self.direction
        distance = np.linalg.norm(local, axis=-1) - 22
        for axis in np.array([[1.0, 0, 0], [0, 1, 0], [0.70710678, 0, 0.70710678]]):
            along = np.clip(local @ axis, 0, 34)
            distance = np.minimum(distance, np.linalg.norm(local - along[..., None] * axis, axis=-1) - 5.5)
        return distance

    def mask(self) -> np.ndarray:
        """Voxels inside, (nx, ny, nz)."""
        index = np.stack(np.meshgrid(*map(np.arange, SHAPE), indexing="ij"), axis=-1)
        return self((index * SPACING) @ self.direction.T + self.origin) < 0

    def image(self, labels: np.ndarray) -> object:
        image = sitk.GetImageFromArray(labels.transpose(2, 1, 0).astype(np.uint8))
        image.SetSpacing(SPACING)
        image.SetOrigin(self.origin)
        image.SetDirection(self.direction.ravel())
        return image


@pytest.mark.parametrize("suffix", ["nii.gz", "nrrd", "mha"])
@pytest.mark.parametrize("mirrored", [False, True])
def test_surface_lies_where_the_chamber_lies(suffix: str, mirrored: bool, tmp_path: Path) -> None:
    direction = turned() * [1, 1, -1 if (np.linalg.det(turned()) < 0) ^ mirrored else 1]
    if mirrored and suffix == "nii.gz":
        pytest.skip("ITK writes no mirrored NIfTI")
    chamber = Chamber(direction)
    mask = chamber.mask()
    sitk.WriteImage(chamber.image(3 * mask), str(tmp_path / f"a.{suffix}"))
    file = read_surface_file(tmp_path / f"a.{suffix}")
    off = chamber(file.surface.vertices)
    assert np.abs(off).mean() < WITHIN
    assert abs(off.mean()) < 0.1  # no half voxel, no shrinking to speak of
    assert file.surface.watertight
    assert file.surface.volume == pytest.approx(mask.sum() * SPACING.prod(), rel=0.02)
    assert (file.space, file.units, file.metadata["label"]) == ("LPS", "mm", 3)


def test_nibabel_sees_the_same_place(tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    chamber = Chamber(turned())
    sitk.WriteImage(chamber.image(chamber.mask()), str(tmp_path / "a.nii.gz"))
    image = nibabel.load(tmp_path / "a.nii.gz")
    index = np.argwhere(np.asarray(image.dataobj) > 0)
    centre = nibabel.affines.apply_affine(image.affine, index).mean(axis=0) * [-1, -1, 1]  # RAS to LPS
    surface = read_surface_file(tmp_path / "a.nii.gz").surface
    weights = surface.face_areas @ surface.vertices[surface.faces].mean(axis=1) / surface.area
    assert np.linalg.norm(centre - weights) < 5.0


def test_labels_boxes_and_pieces(tmp_path: Path) -> None:
    chamber = Chamber(np.eye(3))
    labels = chamber.mask().astype(int)
    labels[60:][labels[60:] == 1] = 2
    labels[:3, :3, :3] = 1  # dust
    sitk.WriteImage(chamber.image(labels), str(tmp_path / "prior.nrrd"))
    with pytest.raises(InputError, match=r"holds 2 labels; say --label \(there are 1, 2\)"):
        read_surface_file(tmp_path / "prior.nrrd")
    with pytest.raises(InputError, match="has no label 7"):
        read_surface_file(tmp_path / "prior.nrrd", label=7)
    file = read_surface_file(tmp_path / "prior.nrrd", label=1)
    assert file.metadata["voxels_of_smaller_pieces"] == 27
    cut = chamber.origin[0] + SPACING[0] * 59.5
    assert file.surface.vertices[:, 0].max() == pytest.approx(cut, abs=0.5)
    half = np.array([50.0, 50, 10])
    low = chamber.centre - half
    high = chamber.centre + half
    boxed = read_surface_file(tmp_path / "prior.nrrd", label=1, box=(*low, *high)).surface
    assert boxed.watertight
    assert np.ptp(boxed.vertices[:, 2]) == pytest.approx(20, abs=SPACING[2] + 0.5)
    (tmp_path / "points.csv").write_text("x,y,z\n" + "".join(f"{k},{k * 9},3\n" for k in range(12)))
    (tmp_path / "case.toml").write_text(f"label = 1\nbox = {[*map(float, low), *map(float, high)]}\n")
    np.testing.assert_array_equal(read_case(tmp_path).prior.vertices, boxed.vertices)


def test_slicer_segments_are_found_by_name(tmp_path: Path) -> None:
    chamber = Chamber(np.eye(3))
    layers = np.stack([chamber.mask(), np.roll(chamber.mask(), 4, axis=2)], axis=-1).astype(np.uint8)
    image = sitk.GetImageFromArray(layers.transpose(2, 1, 0, 3), isVector=True)
    image.SetSpacing(SPACING)
    for k, name in enumerate(("LA", "LV")):
        for key, value in (("Name", name), ("LabelValue", "1"), ("Layer", str(k))):
            image.SetMetaData(f"Segment{k}_{key}", value)
    sitk.WriteImage(image, str(tmp_path / "a.seg.nrrd"))
    first, second = (
        read_surface_file(tmp_path / "a.seg.nrrd", part=name).surface.vertices.mean(axis=0)
        for name in ("LA", "LV")
    )
    np.testing.assert_allclose(second - first, [0, 0, 4 * SPACING[2]], atol=1e-3)
    with pytest.raises(InputError, match=r"in 2 layers; say --layer \(0 to 1\) or --part \(LA, LV\)"):
        read_surface_file(tmp_path / "a.seg.nrrd")


def test_nrrd_in_ras_is_turned_and_no_space_is_unknown(tmp_path: Path) -> None:
    nrrd = pytest.importorskip("nrrd")
    mask = np.zeros((12, 12, 12), np.uint8)
    mask[3:6, 4:9, 5:9] = 1
    geometry = {"space directions": np.eye(3), "space origin": [100.0, 0, 0]}
    for space, centre in (
        ("left-posterior-superior", [104.0, 6, 6.5]),
        ("right-anterior-superior", [-104.0, -6, 6.5]),
    ):
        nrrd.write(str(tmp_path / "a.nrrd"), mask, {"space": space, **geometry})
        file = read_surface_file(tmp_path / "a.nrrd")
        assert file.space == "LPS"
        np.testing.assert_allclose(
            (file.surface.vertices.min(axis=0) + file.surface.vertices.max(axis=0)) / 2, centre, atol=0.05
        )
    nrrd.write(str(tmp_path / "b.nrrd"), mask, {"space dimension": 3, **geometry})
    assert read_surface_file(tmp_path / "b.nrrd").space == "unknown"


def saved(values: np.ndarray, path: Path) -> Path:
    sitk.WriteImage(sitk.GetImageFromArray(values.astype(np.uint8)), str(path))
    return path


def body() -> np.ndarray:
    values = np.zeros((12, 13, 14))
    values[3:8, 4:9, 5:9] = 1
    return values


def test_voxels_behind_another_header_are_found(tmp_path: Path) -> None:
    known = read_surface_file(saved(body(), tmp_path / "a.mhd")).surface.vertices
    raw, text = (tmp_path / "a.raw").read_bytes(), (tmp_path / "a.mhd").read_text()
    (tmp_path / "a.raw").write_bytes(b"head of 17 bytes." + raw)
    for size in (17, -1):
        (tmp_path / "b.mhd").write_text(
            text.replace("ElementDataFile", f"HeaderSize = {size}\nElementDataFile")
        )
        np.testing.assert_array_equal(read_surface_file(tmp_path / "b.mhd").surface.vertices, known)
    for old, new, sentence in (
        ("ElementDataFile", "HeaderSize = -2\nElementDataFile", "HeaderSize = -2: must be"),
        ("BinaryData = True", "BinaryData = False", "BinaryData = False: must be True"),
    ):
        (tmp_path / "b.mhd").write_text(text.replace(old, new))
        with pytest.raises(InputError, match=sentence):
            read_surface_file(tmp_path / "b.mhd")


@pytest.mark.parametrize(
    ("said", "before"),
    [
        (b"byte skip: 7", b"comment"),
        (b"byteskip: 7", b"comment"),  # the alias that other readers honour: voxels were shifted
        (b"byte skip: -1", b"whatever stands before"),
        (b"line skip: 2", b"one\ntwo\n"),
        (b"lineskip: 1\nbyte skip: 3", b"one\nabc"),
    ],
)
@pytest.mark.parametrize("encoding", ["raw", "gzip"])
def test_what_a_nrrd_file_has_before_its_voxels_is_skipped(
    said: bytes, before: bytes, encoding: str, tmp_path: Path
) -> None:
    mask = Chamber(np.eye(3)).mask().astype(np.uint8)
    sizes = " ".join(map(str, mask.shape[::-1]))
    head = (
        f"NRRD0004\ntype: uint8\ndimension: 3\nsizes: {sizes}\nspace: LPS\nspace directions: (1,0,0) (0,1,0) "
        f"(0,0,1)\nspace origin: (0,0,0)\nencoding: {encoding}\n"
    ).encode()
    raw = mask.tobytes()
    if encoding == "gzip":  # lines come before what is compressed, bytes are counted in what was
        line, _, rest = before.rpartition(b"\n")
        body = (line + b"\n" if line else b"") + gzip.compress(rest + raw)
    else:
        body = before + raw
    (tmp_path / "a.nrrd").write_bytes(head + said + b"\n\n" + body)
    (tmp_path / "b.nrrd").write_bytes(head.replace(b"gzip", b"raw") + b"\n" + raw)
    if encoding == "gzip" and b"-1" in said:
        with pytest.raises(InputError, match="'byte skip: -1' must go with raw encoding, not gzip"):
            read_surface_file(tmp_path / "a.nrrd")
        return
    np.testing.assert_array_equal(
        read_surface_file(tmp_path / "a.nrrd").surface.vertices,
        read_surface_file(tmp_path / "b.nrrd").surface.vertices,
    )


def test_a_nifti_whose_sform_contradicts_its_voxel_sizes_is_refused(tmp_path: Path) -> None:
    chamber = Chamber(np.eye(3))
    sitk.WriteImage(chamber.image(chamber.mask().astype(int)), str(tmp_path / "a.nii"))
    data = bytearray((tmp_path / "a.nii").read_bytes())
    sizes = np.frombuffer(bytes(data), "<f4", 3, 80)
    data[80:92] = (sizes * np.float32(1.005)).tobytes()  # rounded
    (tmp_path / "b.nii").write_bytes(data)
    assert len(read_surface_file(tmp_path / "b.nii").surface.faces) > 100
    data[80:92] = (sizes * [1.0, 1.0, 20.0]).astype("<f4").tobytes()
    (tmp_path / "b.nii").write_bytes(data)
    with pytest.raises(InputError, match=r"its sform has voxels of .* its pixdim of .*: make them agree"):
        read_surface_file(tmp_path / "b.nii")


def test_a_grey_image_is_no_label_volume(tmp_path: Path) -> None:
    image = np.random.default_rng(3).integers(0, 832, (20, 20, 20)).astype(np.int16)
    sitk.WriteImage(sitk.GetImageFromArray(image), str(tmp_path / "grey.nrrd"))
    with pytest.raises(
        InputError, match=r"which looks like a grey image, not a label volume: segment the chamber first"
    ):
        read_surface_file(tmp_path / "grey.nrrd")


@pytest.mark.parametrize("kind", ["int16", "float32"])
def test_a_grey_image_is_refused_by_a_few_of_its_slices(kind: str) -> None:
    """It is not copied and sorted as a whole: that took several times its memory."""
    image = np.random.default_rng(3).integers(0, 4000, (120, 160, 160)).astype(kind)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="more than 1000 different values; it is an image"):
            surface_of(Image(image, np.eye(4)), "grey.nii")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < image.nbytes / 4


def test_labels_stored_as_floats_are_labels_and_what_is_not_finite_is_none() -> None:
    values = np.pad(np.full((6, 6, 6), 3.0), 2)
    assert surface_of(Image(values, np.eye(4)), "a.nii").metadata["label"] == 3
    for wrong in (np.nan, np.inf, 0.5, -1e12):
        values[0, 0, 0] = wrong
        with pytest.raises(InputError, match="not whole numbers; it is an image"):
            surface_of(Image(values, np.eye(4)), "a.nii")


def test_nrrd_units_become_millimetres_and_unknown_ones_are_refused(tmp_path: Path) -> None:
    head, _, data = saved(body(), tmp_path / "a.nrrd").read_bytes().partition(b"\n\n")
    known = read_surface_file(tmp_path / "a.nrrd").surface.vertices
    for words, step, factor in (
        ('"cm" "cm" "cm"', b"1", 10),
        ('"mm" "mm" "um"', b"1000", 1),
        ('"" "" "" ""', b"1", 1),
        ("mm mm mm", b"1", 1),
    ):
        stated = head.replace(b"(0,0,1)", b"(0,0,%b)" % step) + f"\nspace units: {words}\n\n".encode()
        (tmp_path / "b.nrrd").write_bytes(stated + data)
        np.testing.assert_allclose(
            read_surface_file(tmp_path / "b.nrrd").surface.vertices, known * factor, rtol=1e-6
        )
    (tmp_path / "b.nrrd").write_bytes(head + b'\nspace units: "mi" "mi" "mi"\n\n' + data)
    with pytest.raises(InputError, match=r'space units "mi" "mi" "mi": must be three of mm, millimeter'):
        read_surface_file(tmp_path / "b.nrrd")
    (tmp_path / "b.nrrd").write_bytes(head.replace(b"(0,0,1)", b"(0,0,1_0)") + b"\n\n" + data)
    with pytest.raises(InputError, match="space directions: value '1_0' is not a number"):
        read_surface_file(tmp_path / "b.nrrd")


def test_data_may_be_named_with_a_dot_and_a_slash(tmp_path: Path) -> None:
    path = saved(body(), tmp_path / "a.nhdr")
    known = read_surface_file(path).surface.vertices
    path.write_text(path.read_text().replace("data file: ", "data file: ./"))
    np.testing.assert_array_equal(read_surface_file(path).surface.vertices, known)
    path.write_text(path.read_text().replace("data file: ./", "data file: ../"))
    with pytest.raises(InputError, match="must be one file in the same folder"):
        read_surface_file(path)


def test_labels_that_enclose_nothing_are_refused(tmp_path: Path) -> None:
    values = body()
    values[0, 0, 0], values[0, 5, :] = 2, 3
    path = saved(values, tmp_path / "a.mha")
    for label in (2, 3):
        with pytest.raises(
            InputError, match=rf"a\.mha: label {label}: its \d+ voxels are too few or lie too thin"
        ):
            read_surface_file(path, label=label)
    with pytest.raises(InputError, match="no voxel of label 1 lies in the box"):
        read_surface_file(path, label=1, box=(50, 50, 50, 60, 60, 60))
    with pytest.raises(InputError, match="label 1 and part 'LA' are both given"):
        read_surface_file(path, label=1, part="LA")


def test_segments_without_voxels_or_layer_are_refused(tmp_path: Path) -> None:
    head, _, data = saved(body(), tmp_path / "a.nrrd").read_bytes().partition(b"\n\n")
    notes = "Segment0_Name:=LA\nSegment0_LabelValue:=7\nSegment1_Name:=LV\nSegment1_Layer:=3\n"
    (tmp_path / "a.nrrd").write_bytes(head + f"\n{notes}\n".encode() + data)
    with pytest.raises(InputError, match="no voxel of label 7 is there"):
        read_surface_file(tmp_path / "a.nrrd", part="LA")
    with pytest.raises(InputError, match="segment 'LV' is in layer 3: there are 1"):
        read_surface_file(tmp_path / "a.nrrd", part="LV")


def test_pieces_that_are_left_out_are_told(tmp_path: Path) -> None:
    values = body()
    values[0, 0, :4] = 1
    told = convert(saved(values, tmp_path / "a.mha"), tmp_path / "a.ply")
    assert any("4 voxels of smaller pieces are left out" in sentence for sentence in told)


def test_what_is_no_label_volume_is_refused(tmp_path: Path) -> None:
    grey = sitk.GetImageFromArray(np.random.default_rng(SEED).normal(size=(5, 6, 7)))
    sitk.WriteImage(grey, str(tmp_path / "a.nrrd"))
    with pytest.raises(InputError, match="not whole numbers; it is an image"):
        read_surface_file(tmp_path / "a.nrrd")
    sitk.WriteImage(sitk.GetImageFromArray(np.ones((5, 6, 7), np.uint8)), str(tmp_path / "b.nii"))
    header = bytearray((tmp_path / "b.nii").read_bytes())
    header[252:256] = bytes(4)
    (tmp_path / "b.nii").write_bytes(bytes(header))
    with pytest.raises(InputError, match="neither qform nor sform"):
        read_surface_file(tmp_path / "b.nii")
    (tmp_path / "c.nii").write_bytes(bytes(header[:360]))
    with pytest.raises(InputError, match=r"c\.nii"):
        read_surface_file(tmp_path / "c.nii")


def test_the_oblique_sample_is_one_body_in_three_formats(shared_data: Path) -> None:
    found = [
        read_surface_file(p, label=1).surface
        for p in sorted((shared_data / "formats/samples/labelmap").glob("oblique*"))
    ]
    assert len(found) == 3
    for other in found[1:]:
        np.testing.assert_allclose(other.vertices, found[0].vertices, atol=1e-3)


def nifti_of(values: np.ndarray, path: Path, kind: str = "Nifti1Image", code: int = 1) -> Path:
    """Labels (nx, ny, nz[, layers]) as nibabel writes them: RAS, voxels of 1 x 1 x 2 mm."""
    nibabel = pytest.importorskip("nibabel")
    image = getattr(nibabel, kind)(values.astype(np.uint8), np.diag([1.0, 1, 2, 1]))
    image.header.set_xyzt_units("mm")
    image.set_sform(image.affine, code=code)
    image.set_qform(image.affine, code=0)
    nibabel.save(image, path)
    return path


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("Nifti2Image", "b.nii"),
        ("Nifti2Image", "b.nii.gz"),
        ("Nifti1Pair", "b.hdr"),
        ("Nifti2Pair", "b.hdr"),
    ],
)
def test_nifti_2_and_pairs_lie_where_nifti_1_lies(kind: str, name: str, tmp_path: Path) -> None:
    known = read_surface_file(nifti_of(body(), tmp_path / "a.nii")).surface
    file = read_surface_file(nifti_of(body(), tmp_path / name, kind))
    np.testing.assert_array_equal(file.surface.vertices, known.vertices)
    # 3 to 7 along i, 5 to 8 along k: RAS to LPS turns x and y
    middle = (known.vertices.min(axis=0) + known.vertices.max(axis=0)) / 2
    np.testing.assert_allclose(middle, [-5.0, -6.0, 13.0], atol=0.05)
    assert file.space == "LPS"


def test_a_pair_without_its_voxels_is_refused(tmp_path: Path) -> None:
    path = nifti_of(body(), tmp_path / "b.hdr", "Nifti1Pair")
    for content in (b"short", b""):
        (tmp_path / "b.img").write_bytes(content)
        with pytest.raises(InputError, match=r"b\.hdr: .* the file is truncated|b\.img: is empty"):
            read_surface_file(path)
    with pytest.raises(InputError, match=r"b\.img: holds voxels alone: name its header, b\.hdr"):
        convert(tmp_path / "b.img", tmp_path / "a.ply")
    (tmp_path / "b.img").unlink()
    with pytest.raises(InputError, match=r"its data file 'b\.img' is not beside it"):
        read_surface_file(path)


def test_a_nifti_without_a_form_asks_how_its_axes_lie(tmp_path: Path) -> None:
    path = nifti_of(body(), tmp_path / "b.nii", code=0)
    with pytest.raises(InputError, match=r"neither qform nor sform.*say --frame RAS where i, j and k run to"):
        read_surface_file(path)
    middles = {}
    for frame in ("LPS", "RAS"):
        told = convert(path, tmp_path / "b.ply", frame=frame, to="LPS")
        assert f"frame {frame}" in told[0]
        vertices = read_surface_file(tmp_path / "b.ply").surface.vertices
        middles[frame] = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    np.testing.assert_allclose(middles["LPS"], [5.0, 6.0, 13.0], atol=0.05)
    np.testing.assert_allclose(middles["RAS"], [-5.0, -6.0, 13.0], atol=0.05)


def test_a_case_says_the_frame_of_a_prior_without_a_form(tmp_path: Path) -> None:
    values = np.zeros((30, 30, 30))
    values[5:25, 5:25, 5:25] = 1
    nifti_of(values, tmp_path / "prior.hdr", "Nifti1Pair", code=0)
    (tmp_path / "points.csv").write_text("x,y,z\n" + "".join(f"{k},{k * 9},3\n" for k in range(12)))
    with pytest.raises(InputError, match="say --frame"):
        read_case(tmp_path)
    case = read_case(tmp_path, frame="LPS")
    assert case.prior.vertices.max(axis=0) == pytest.approx([24.5, 24.5, 49], abs=0.1)
    assert {"prior.hdr", "prior.img"} <= case.files.keys()


@pytest.mark.parametrize("code, message", [(1, "metres"), (3, "micrometres")])  # noqa: PT006
def test_lengths_of_a_nifti_in_other_units_become_millimetres(
    code: int, message: str, tmp_path: Path
) -> None:
    data = bytearray(nifti_of(body(), tmp_path / "a.nii").read_bytes())
    data[123] = code
    factor = {1: 1000.0, 3: 0.001}[code]
    known = read_surface_file(tmp_path / "a.nii").surface.vertices
    (tmp_path / "b.nii").write_bytes(data)
    np.testing.assert_allclose(
        read_surface_file(tmp_path / "b.nii").surface.vertices, known * factor, rtol=1e-6
    )


def cine(moves: int = 3) -> np.ndarray:
    """Phases (nx, ny, nz, t) of one body that moves by a voxel along i."""
    return np.stack([np.roll(body(), k, axis=0) for k in range(moves)], axis=-1)


def as_list(name: str, first: bool, values: np.ndarray, folder: Path) -> Path:
    """A 4D NRRD whose list axis comes first or last."""
    axes = "(1,0,0) (0,1,0) (0,0,2)"
    axes = f"none {axes}" if first else f"{axes} none"
    values = np.moveaxis(values, -1, 0) if first else values
    head = (
        f"NRRD0004\ntype: uint8\ndimension: 4\nsizes: {' '.join(map(str, values.shape))}\nspace: RAS\n"
        f"space directions: {axes}\nspace origin: (0,0,0)\nencoding: raw\n\n"
    )
    (folder / name).write_bytes(head.encode() + values.astype(np.uint8).tobytes(order="F"))
    return folder / name


def as_meta(joined: str, folder: Path) -> Path:
    """The phases as a fourth axis or as channels of a MetaImage."""
    images = [sitk.GetImageFromArray(cine()[..., k].T.astype(np.uint8)) for k in range(3)]
    for image in images:
        image.SetSpacing([1.0, 1.0, 2.0])
        image.SetDirection(np.diag([-1.0, -1, 1]).ravel())
    whole = sitk.JoinSeries(images) if joined == "series" else sitk.Compose(images)
    sitk.WriteImage(whole, str(folder / "a.mha"), useCompression=True)
    return folder / "a.mha"


@pytest.mark.parametrize("kind", ["nii", "first.nrrd", "last.nrrd", "series", "channels"])
def test_a_phase_or_layer_is_chosen_by_its_number(kind: str, tmp_path: Path) -> None:
    known = read_surface_file(nifti_of(body(), tmp_path / "one.nii")).surface.vertices
    if kind == "nii":
        path = nifti_of(cine(), tmp_path / "a.nii")
    elif kind.endswith("nrrd"):
        path = as_list(kind, kind == "first.nrrd", cine(), tmp_path)
    else:
        path = as_meta(kind, tmp_path)
    with pytest.raises(InputError, match=r"label 1 is in 3 layers; say --layer \(0 to 2\)$"):
        read_surface_file(path)
    with pytest.raises(InputError, match="there is no layer 3: there are 3, counted from 0"):
        read_surface_file(path, layer=3)
    for layer in range(3):
        vertices = read_surface_file(path, layer=layer).surface.vertices
        np.testing.assert_allclose(vertices, known - [layer, 0, 0], atol=1e-4)
    with pytest.raises(InputError, match="part 'LA' and layer 1 are both given"):
        read_surface_file(path, part="LA", layer=1)


def test_a_case_and_the_command_line_choose_a_phase(tmp_path: Path) -> None:
    from click.testing import CliRunner

    from o3dls.cli.commands import cli

    nifti_of(cine(), tmp_path / "cine.nii.gz")
    done = CliRunner().invoke(
        cli, ["convert", str(tmp_path / "cine.nii.gz"), str(tmp_path / "prior.ply"), "--phase", "2"]
    )
    assert done.exit_code == 0, done.output
    converted = read_surface_file(tmp_path / "prior.ply").surface
    (tmp_path / "points.csv").write_text("x,y,z\n" + "".join(f"{k},{k * 9},3\n" for k in range(12)))
    (tmp_path / "case.toml").write_text('prior = "cine.nii.gz"\nlayer = 2\n')
    np.testing.assert_allclose(read_case(tmp_path).prior.vertices, converted.vertices, atol=1e-5)


def test_labels_of_a_cine_are_named_once(tmp_path: Path) -> None:
    path = nifti_of(np.where(cine() > 0, 1, 0) + 2 * (np.roll(cine(), 5, axis=1) > 0), tmp_path / "a.nii")
    with pytest.raises(InputError, match=r"holds \d labels; say --label \(there are 1, 2(, 3)?\)$"):
        read_surface_file(path)


@pytest.mark.parametrize("damage", ["checksum", "end"])
def test_packed_voxels_must_agree_with_their_checksum(damage: str, tmp_path: Path) -> None:
    path = nifti_of(body(), tmp_path / "a.nii.gz")
    data = bytearray(path.read_bytes())
    data[-8] ^= 1  # the checksum of gzip, then the length
    path.write_bytes(data if damage == "checksum" else data[:-4])
    with pytest.raises(InputError, match=r"packed data (are damaged|have no end: the file is truncated)"):
        read_surface_file(path)


def test_a_nifti_that_claims_more_than_it_holds_takes_no_memory(tmp_path: Path) -> None:
    """nibabel itself takes what the header claims, here 216 MB, before it looks."""
    import tracemalloc

    data = bytearray(nifti_of(body(), tmp_path / "a.nii").read_bytes())
    data[42:48] = np.array([600, 600, 600], "<i2").tobytes()
    (tmp_path / "a.nii").write_bytes(data)
    tracemalloc.start()
    with pytest.raises(InputError, match="the file is truncated"):
        read_surface_file(tmp_path / "a.nii")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6  # bytes; the import of nibabel included


@pytest.mark.parametrize("layers", [0, 3])
def test_a_nrrd_with_spacings_alone_asks_how_its_axes_lie(layers: int, tmp_path: Path) -> None:
    values = cine(layers) if layers else body()
    known = read_surface_file(nifti_of(body(), tmp_path / "one.nii")).surface.vertices
    head = (
        f"NRRD0004\ntype: uint8\ndimension: {values.ndim}\nsizes: {' '.join(map(str, values.shape))}\n"
        f"encoding: raw\nspacings: 0.1 0.1 0.2{' nan' if layers else ''}\n"
        f'units: "cm" "cm" "cm"{" " + chr(34) + "ms" + chr(34) if layers else ""}\n'
    )
    content = values.astype(np.uint8).tobytes(order="F")
    path = tmp_path / "a.nrrd"
    path.write_bytes(head.encode() + b"\n" + content)
    choice = {"layer": 0} if layers else {}
    with pytest.raises(InputError, match=r"spacings and no space directions, .* say --frame RAS where"):
        read_surface_file(path, **choice)
    file = read_surface_file(path, frame="RAS", **choice)
    np.testing.assert_allclose(file.surface.vertices, known * [-1, -1, 1], atol=1e-5)
    assert (file.space, file.units) == ("RAS", "mm")
    for line, sentence in (
        (f"spacings: 0.1 0.1 -0.2{' nan' if layers else ''}", "must be three above 0"),
        ("spacings: 0.1 0.1", "must be"),
        ("axis mins: 3 3 3", "NRRD has 'axis mins' beside 'spacings'"),
    ):
        kept = [old for old in head.splitlines() if not old.startswith(line.split(":")[0])]
        path.write_bytes("\n".join([*kept, line, "", ""]).encode() + content)
        with pytest.raises(InputError, match=sentence):
            read_surface_file(path, frame="RAS", **choice)


def test_analyze_is_told_from_nifti_and_refused(tmp_path: Path) -> None:
    path = nifti_of(body(), tmp_path / "b.hdr", "Nifti1Pair")
    path.write_bytes(path.read_bytes()[:344] + bytes(4))
    with pytest.raises(InputError, match=r"b\.hdr: is Analyze 7.5, which does not say left from right"):
        read_surface_file(path)


@pytest.mark.parametrize("form", ["a.nii", "a.nii.gz"])
def test_a_large_volume_takes_little_more_memory_than_its_voxels(form: str, tmp_path: Path) -> None:
    """Of 1 MB that unpack to 640 x 640 x 640 voxels, labelling all of them took 3.7 GB."""
    import tracemalloc

    volume = np.zeros((300, 300, 300), np.uint8)
    volume[120:160, 130:170, 140:180] = 1

    def peak(path: Path) -> int:
        tracemalloc.start()
        read_surface_file(path)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    small = nifti_of(volume[110:170, 120:180, 130:190], tmp_path / f"small_{form}")
    peak(small)  # imports
    assert peak(nifti_of(volume, tmp_path / form)) < peak(small) + 1.3 * volume.size


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("touches", [None, "low", "high"])
def test_a_label_lies_where_it_lay_however_much_is_around_it(
    axis: int, touches: str | None, tmp_path: Path
) -> None:
    """What is cut out around a label changes neither where it lies nor how it is closed."""
    small = np.zeros((18, 20, 22), np.uint8)
    small[4:14, 5:15, 6:16] = 1
    small[7:9, 7:9, 3:19] = 1
    small = np.moveaxis(small, 2, axis)
    inner = small
    if touches:
        inner = small.take(np.arange(8, small.shape[axis]) if touches == "low" else np.arange(10), axis)
    more = [(0, 0) if other == axis and touches else (30, 30) for other in range(3)]
    near = read_surface_file(nifti_of(inner, tmp_path / "near.nii")).surface
    far = read_surface_file(nifti_of(np.pad(inner, more), tmp_path / "far.nii")).surface
    shift = np.array([0.0 if a == axis and touches else 30.0 for a in range(3)]) * [-1, -1, 2]
    np.testing.assert_allclose(far.vertices, near.vertices + shift, atol=1e-6)
    assert np.array_equal(far.faces, near.faces)


@pytest.mark.parametrize("kind", ["u1", "i2", "u8", "i8", "f4"])
def test_labels_are_those_that_numpy_finds(kind: str) -> None:
    values = np.array([[3, 3, 0], [120, 7, 3]]).astype(kind)
    cases = [values, values + np.array(1 << 40).astype(kind)] if kind in ("u8", "i8") else [values]
    if kind in ("i2", "i8"):
        cases.append(-values)
    for one in cases:
        assert whole_values("a", one) == set(np.unique(one).tolist())
    most = np.array([[2**64 - 1, 2**64 - 3]], dtype="u8")
    assert whole_values("a", most) == {2**64 - 1, 2**64 - 3}
    wide = np.array([[-(1 << 62), 1 << 62, 5]], dtype="i8")
    assert whole_values("a", wide) == {-(1 << 62), 1 << 62, 5}
