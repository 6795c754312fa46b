"""DICOM: segmentations lie where their frames say, by name and by number; images are told to be none."""

from __future__ import annotations

import re
import sys
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from o3dls.errors import InputError
from o3dls.io.case_reader import read_case
from o3dls.io.images.wall import mask_surface
from o3dls.io.surfaces import is_surface, read_surface_file
from o3dls.runs.conversion import convert

pydicom = pytest.importorskip("pydicom", reason="DICOM needs highdicom: pip install 'o3dls[dicom]'")
highdicom = pytest.importorskip("highdicom", reason="DICOM needs highdicom: pip install 'o3dls[dicom]'")

SHAPE = (20, 44, 40)  # slices, rows, columns
SPACING = np.array([1.2, 1.0, 2.5])  # along columns, rows, slices
ORIGIN = np.array([-20.0, 35.0, 110.0])
SEED = 61_022


def turned(mirrored: bool = False) -> np.ndarray:
    axes = np.linalg.qr(np.random.default_rng(SEED).normal(size=(3, 3)))[0]
    sign = -1 if (np.linalg.det(axes) < 0) ^ mirrored else 1
    return np.asarray(axes * [1, 1, sign])


def series(axes: np.ndarray, steps: np.ndarray | None = None) -> list[Any]:
    """Slices of a CT: columns of `axes` are the directions along columns, rows and slices."""
    from pydicom.dataset import Dataset, FileMetaDataset
    from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid

    study, own, frame = (generate_uid() for _ in range(3))
    slices = []
    for k, step in enumerate(SPACING[2] * np.arange(SHAPE[0]) if steps is None else steps):
        image = Dataset()
        image.file_meta = FileMetaDataset()
        image.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        image.SOPClassUID = image.file_meta.MediaStorageSOPClassUID = CTImageStorage
        image.SOPInstanceUID = image.file_meta.MediaStorageSOPInstanceUID = generate_uid()
        image.StudyInstanceUID, image.SeriesInstanceUID, image.FrameOfReferenceUID = study, own, frame
        image.Modality, image.Manufacturer, image.PatientName, image.PatientID = "CT", "x", "Anon^Anon", "0"
        for key in ("PatientBirthDate", "PatientSex", "AccessionNumber", "ReferringPhysicianName"):
            setattr(image, key, "")
        image.StudyID, image.StudyDate, image.StudyTime = "1", "20200101", "000000"
        image.SeriesNumber, image.InstanceNumber = 1, k + 1
        image.Rows, image.Columns, image.SamplesPerPixel = *SHAPE[1:], 1
        image.PixelSpacing, image.SliceThickness = [SPACING[1], SPACING[0]], SPACING[2]
        image.ImageOrientationPatient = [*axes[:, 0], *axes[:, 1]]
        image.ImagePositionPatient = list(ORIGIN + axes[:, 2] * step)
        image.PhotometricInterpretation, image.PixelRepresentation = "MONOCHROME2", 0
        image.BitsAllocated, image.BitsStored, image.HighBit = 16, 16, 15
        image.PixelData = np.zeros(SHAPE[1:], np.uint16).tobytes()
        slices.append(image)
    return slices


def segmentation(
    path: Path, values: np.ndarray, names: list[str], slices: list[Any], kind: str = "BINARY"
) -> Path:
    """A SEG as highdicom writes it; empty slices are left out."""
    from pydicom.sr.codedict import codes

    described = [
        highdicom.seg.SegmentDescription(
            segment_number=number,
            segment_label=name,
            segmented_property_category=codes.SCT.AnatomicalStructure,
            segmented_property_type=codes.SCT.Heart,
            algorithm_type="MANUAL",
        )
        for number, name in enumerate(names, 1)
    ]
    highdicom.seg.Segmentation(
        source_images=slices,
        pixel_array=values,
        segmentation_type=kind,
        segment_descriptions=described,
        series_instance_uid=highdicom.UID(),
        series_number=2,
        sop_instance_uid=highdicom.UID(),
        instance_number=1,
        manufacturer="x",
        manufacturer_model_name="x",
        software_versions="1",
        device_serial_number="1",
    ).save_as(path)
    return path


def ball(centre: tuple[int, int, int], radius: float) -> np.ndarray:
    """Voxels (slices, rows, columns) of a ball in mm about a voxel."""
    index = np.stack(np.indices(SHAPE), axis=-1) - centre
    return np.asarray(np.linalg.norm(index * SPACING[::-1], axis=-1) < radius)


ATRIUM, VENTRICLE = (7, 20, 18), (14, 30, 25)


def labels() -> np.ndarray:
    values = np.zeros(SHAPE, np.uint8)
    values[ball(VENTRICLE, 9.0)] = 2
    values[ball(ATRIUM, 11.0)] = 1
    return values


def place(index: tuple[int, int, int], axes: np.ndarray) -> np.ndarray:
    """Where a voxel lies, by the definition of DICOM (PS3.3, C.7.6.2.1.1)."""
    return np.asarray(ORIGIN + axes @ (SPACING * index[::-1]))


def middle(vertices: np.ndarray) -> np.ndarray:
    return np.asarray((vertices.min(axis=0) + vertices.max(axis=0)) / 2)


@pytest.mark.parametrize("kind", ["BINARY", "LABELMAP"])
@pytest.mark.parametrize("mirrored", [False, True])
def test_segments_lie_where_their_frames_say(kind: str, mirrored: bool, tmp_path: Path) -> None:
    axes = turned(mirrored)
    path = segmentation(tmp_path / "seg.dcm", labels(), ["LA", "LV"], series(axes), kind)
    for number, name in ((1, "LA"), (2, "LV")):
        by_number, by_name = (read_surface_file(path, **o) for o in ({"label": number}, {"part": name}))
        np.testing.assert_array_equal(by_number.surface.vertices, by_name.surface.vertices)
        assert by_name.surface.watertight
        assert by_name.surface.volume > 0
        assert (by_name.space, by_name.units) == ("LPS", "mm")
    # the atrium is whole, so its middle is that of the ball: to a tenth of a voxel
    vertices = read_surface_file(path, part="LA").surface.vertices
    np.testing.assert_allclose(middle(vertices @ axes), middle(place(ATRIUM, axes)[None] @ axes), atol=0.1)
    with pytest.raises(
        InputError, match=r"holds 2 labels; say --label \(there are 1, 2\) or --part \(LA, LV\)"
    ):
        read_surface_file(path)
    with pytest.raises(InputError, match=r"has no segment 'la'(: did you mean 'LA'|; there are: LA, LV)"):
        read_surface_file(path, part="la")


def test_simpleitk_reads_the_same_labels_at_the_same_place(tmp_path: Path) -> None:
    """The same voxels as NRRD, placed by SimpleITK, lead to the same surface."""
    sitk = pytest.importorskip("SimpleITK")
    axes = turned()
    image = sitk.GetImageFromArray(labels())
    image.SetSpacing(SPACING)
    image.SetOrigin(ORIGIN)
    image.SetDirection(axes.ravel())
    sitk.WriteImage(image, str(tmp_path / "a.nrrd"))
    known = read_surface_file(tmp_path / "a.nrrd", label=2).surface.vertices
    path = segmentation(tmp_path / "seg.dcm", labels(), ["LA", "LV"], series(axes))
    found = read_surface_file(path, label=2).surface.vertices
    assert len(found) == len(known)
    for one, other in ((found, known), (known, found)):  # highdicom may count the slices the other way
        assert cKDTree(one).query(other)[0].max() < 1e-3


def test_overlapping_segments_and_probabilities_keep_each_to_itself(tmp_path: Path) -> None:
    whole, inner = ball(ATRIUM, 12.0), ball(ATRIUM, 6.0)
    both = np.stack([whole, inner], axis=-1)
    slices = series(np.eye(3))
    bits = segmentation(tmp_path / "bits.dcm", both.astype(np.uint8), ["LA", "LA"], slices)
    shares = segmentation(
        tmp_path / "shares.dcm", np.where(both, 0.8, 0.3), ["LA", "LA"], slices, "FRACTIONAL"
    )
    for path in (bits, shares):
        volumes = {k: read_surface_file(path, label=k).surface.volume for k in (1, 2)}
        for k, mask in ((1, whole), (2, inner)):
            known = mask_surface(mask, np.diag([*SPACING, 1.0])).volume
            assert volumes[k] == pytest.approx(known, rel=1e-6)
        # segments of one name are told apart by their numbers
        part = read_surface_file(path, part="LA (2)").surface
        assert part.volume == pytest.approx(volumes[2])


def test_slices_that_are_missing_or_uneven_are_not_closed_up(tmp_path: Path) -> None:
    values = np.zeros(SHAPE, np.uint8)
    values[3:6, 10:20, 10:20] = values[12:16, 10:20, 10:20] = 1
    path = segmentation(tmp_path / "gap.dcm", values, ["LA"], series(np.eye(3)))
    with pytest.raises(InputError, match=r"57% of its 700 voxels .* blank slices lie within it, 6 of them"):
        read_surface_file(path)
    whole = read_surface_file(path, fill_slices=True).surface.vertices
    assert middle(whole)[2] == pytest.approx(ORIGIN[2] + 9.0 * SPACING[2], abs=0.1)
    values[3:5] = 0
    path = segmentation(tmp_path / "gap.dcm", values, ["LA"], series(np.eye(3)))
    file = read_surface_file(path)  # the larger piece, at its own height
    assert file.metadata["voxels_of_smaller_pieces"] == 100
    assert middle(file.surface.vertices)[2] == pytest.approx(ORIGIN[2] + 13.5 * SPACING[2], abs=0.1)
    uneven = np.cumsum(np.where(np.arange(SHAPE[0]) % 2, 1.0, 3.3))
    path = segmentation(tmp_path / "uneven.dcm", labels(), ["LA", "LV"], series(np.eye(3), uneven))
    with pytest.raises(InputError, match="not parallel slices at equal distances: resample it"):
        read_surface_file(path, part="LA")


@pytest.mark.parametrize("stated", [1.25, 2.4, 5.0, 2.5])
@pytest.mark.parametrize("oblique", [False, True])
def test_a_spacing_that_contradicts_the_places_of_the_frames_is_refused(
    stated: float, oblique: bool, tmp_path: Path
) -> None:
    """With half of the spacing every second slice counted as missing, and the largest piece was one slice."""
    path = segmentation(
        tmp_path / "seg.dcm", labels(), ["LA", "LV"], series(turned() if oblique else np.eye(3))
    )
    dataset = pydicom.dcmread(path)
    measures = dataset.SharedFunctionalGroupsSequence[0].PixelMeasuresSequence[0]
    measures.SpacingBetweenSlices = stated
    dataset.save_as(path)
    if stated == SPACING[2]:
        assert read_surface_file(path, part="LA").surface.watertight
        return
    sentence = rf"slices are {stated:g} mm apart \(SpacingBetweenSlices\), and its frames lie 2\.5 mm apart"
    with pytest.raises(InputError, match=sentence):
        read_surface_file(path, part="LA")


def test_bytes_that_are_missing_or_too_many_are_not_read_as_voxels(tmp_path: Path) -> None:
    data = segmentation(tmp_path / "seg.dcm", labels(), ["LA", "LV"], series(np.eye(3))).read_bytes()
    path = tmp_path / "damaged.dcm"
    for damaged in (data[:-30], data[:-900] + b"\0" * 30 + data[-900:], data[:-900] + data[-800:]):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=r"damaged\.dcm: (cannot be read as|30 bytes follow its voxels)"):
            read_surface_file(path, part="LA")


def test_a_case_names_a_segment(tmp_path: Path) -> None:
    segmentation(tmp_path / "prior.dcm", labels(), ["LA", "LV"], series(np.eye(3)))
    (tmp_path / "points.csv").write_text("x,y,z\n" + "".join(f"{k},{k * 9},3\n" for k in range(12)))
    (tmp_path / "case.toml").write_text('part = "LA"\n')
    assert read_case(tmp_path).prior.watertight
    told = convert(tmp_path / "prior.dcm", tmp_path / "la.ply", part="LA")
    assert "frame LPS, units mm" in told[0]


def test_images_are_told_to_be_segmented_first(tmp_path: Path) -> None:
    (tmp_path / "ct").mkdir()
    for k, image in enumerate(series(np.eye(3))[:3]):
        image.save_as(tmp_path / "ct" / f"{k}.dcm", enforce_file_format=True)
    with pytest.raises(
        InputError, match=r"0\.dcm: is DICOM of modality CT .*: segment the left atrium first, .*3D S"
    ):
        convert(tmp_path / "ct" / "0.dcm", tmp_path / "a.ply")
    for read in (is_surface, read_surface_file):
        with pytest.raises(
            InputError, match=r"ct: is a folder of DICOM files; .* name it.* segment the left atrium"
        ):
            read(tmp_path / "ct")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty: is a folder; name a file"):
        is_surface(tmp_path / "empty")


def test_without_highdicom_it_is_said_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = segmentation(tmp_path / "seg.dcm", labels(), ["LA", "LV"], series(np.eye(3)))
    monkeypatch.setitem(sys.modules, "highdicom", None)
    with pytest.raises(
        InputError, match=r"pip install 'o3dls\[dicom\]'; if it is an image, segment the left"
    ):
        read_surface_file(path, part="LA")


def deflated(path: Path) -> tuple[Path, int]:
    """The segmentation, packed as a whole data set, and where that begins."""
    from pydicom.uid import DeflatedExplicitVRLittleEndian

    data = pydicom.dcmread(segmentation(path, labels(), ["LA", "LV"], series(np.eye(3))))
    data.file_meta.TransferSyntaxUID = DeflatedExplicitVRLittleEndian
    data.save_as(path, enforce_file_format=True)
    return path, 144 + int.from_bytes(path.read_bytes()[140:144], "little")


def test_a_deflated_data_set_is_read_within_bounds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = segmentation(tmp_path / "b.dcm", labels(), ["LA", "LV"], series(np.eye(3)))
    path, begins = deflated(tmp_path / "a.dcm")
    whole = path.read_bytes()
    known = read_surface_file(plain, part="LA").surface.vertices
    np.testing.assert_array_equal(read_surface_file(path, part="LA").surface.vertices, known)
    pack = zlib.compressobj(9, zlib.DEFLATED, -15)
    bomb = b"".join(pack.compress(bytes(1 << 24)) for _ in range(4)) + pack.flush()
    monkeypatch.setattr("o3dls.io.images.dicom.MOST_BYTES", 1 << 25)
    for content in (bomb, whole[begins:-40], whole[begins : begins + 9]):
        path.write_bytes(whole[:begins] + content)
        with pytest.raises(InputError, match=r"a\.dcm: its packed data set has no end within"):
            read_surface_file(path, part="LA")
    path.write_bytes(whole[:132] + b"x" * 12 + whole[144:])  # it does not say where the data set begins
    with pytest.raises(InputError, match=r"a\.dcm"):
        read_surface_file(path, part="LA")


@pytest.mark.parametrize(("kind", "scale"), [("LABELMAP", 1), ("FRACTIONAL", 255)])
def test_segments_packed_by_run_lengths_are_the_same(kind: str, scale: int, tmp_path: Path) -> None:
    """RLE is what pydicom packs and unpacks itself; 3D Slicer and others write it."""
    from pydicom.uid import RLELossless

    values = labels() if kind == "LABELMAP" else (labels() == 1).astype(np.float32)[..., None]
    names = ["LA", "LV"] if kind == "LABELMAP" else ["LA"]
    plain = segmentation(tmp_path / "plain.dcm", values, names, series(turned()), kind)
    data = pydicom.dcmread(plain)
    data.compress(RLELossless)
    data.save_as(tmp_path / "packed.dcm")
    assert pydicom.dcmread(tmp_path / "packed.dcm").file_meta.TransferSyntaxUID == RLELossless
    one, other = (read_surface_file(path, part="LA") for path in (plain, tmp_path / "packed.dcm"))
    np.testing.assert_array_equal(one.surface.vertices, other.surface.vertices)


def test_a_packing_that_nothing_here_unpacks_is_named(tmp_path: Path) -> None:
    """Deflated frames came into DICOM in 2024, and pydicom 3.0 has no decoder for them."""
    path = segmentation(tmp_path / "a.dcm", labels(), ["LA", "LV"], series(turned()), "LABELMAP")
    plain = path.read_bytes()
    data = pydicom.dcmread(path)
    data.compress(pydicom.uid.RLELossless)
    data.file_meta.TransferSyntaxUID = jpeg = pydicom.uid.JPEG2000MC  # nothing decodes its second part
    data.save_as(path)
    frames = b"1.2.840.10008.1.2.8.1\0"
    for syntax in (jpeg.encode(), frames):
        path.write_bytes(path.read_bytes().replace(jpeg.encode(), syntax))
        name = re.escape(syntax.decode().rstrip("\0"))
        with pytest.raises(InputError, match=rf"packed by .*{name}\), which pydicom .* without compression"):
            read_surface_file(path, part="LA")
    path.write_bytes(plain)  # as other programs save it without
    assert read_surface_file(path, part="LA").surface.watertight
