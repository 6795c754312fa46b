"""Measured points in OpenEP's files: read back by us, and laid out as OpenEP's own Python reader needs them.

What that reader does is known from its source, and is done here again with scipy: it squeezes all axes of
one, takes a point whose signal is nowhere a number for one without a measurement, takes voltages from the
amplitude of the signal within the window of interest, and makes whole numbers of annotations.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from formats import marker

from o3dls.case import Points
from o3dls.io.matlab import openep
from o3dls.io.surfaces import read_surface

BUFFER = 50.0  # ms, by which that reader widens the window of interest
HALF_A_SAMPLE = 0.005  # ms, of a hundredth of a ms


def points(lat: list[float]) -> Points:
    """As many measured points as times, then two ablation sites, a landmark and a point inside."""
    n = len(lat)
    rng = np.random.default_rng(71_203)
    kinds = ["eam"] * n + ["ablation"] * 2 + ["landmark", "inside"]
    bipolar, unipolar = rng.uniform(0.1, 4, len(kinds)), rng.uniform(1, 9, len(kinds))
    bipolar[1] = np.nan
    columns = {
        "bipolar": bipolar,
        "unipolar": unipolar,
        "lat": np.append(lat, np.full(4, np.nan)),
        "force": np.append(np.full(n, np.nan), [11.0, 12.5, np.nan, np.nan]),
        "name": np.array([""] * (n + 2) + ["LSPV", ""]),
    }
    return Points(rng.normal(0, 30, (len(kinds), 3)), np.array(kinds), columns)


TIMES = {
    "whole": [-120.0, 33.0, np.nan, 80.0, 0.0],
    "late only": [300.0, 310.0, np.nan, 420.0, 333.0],
    "early only": [-300.0, -310.0, np.nan, -420.0, -333.0],
    "parts of a ms": [-12.34, 0.491, np.nan, 1234.567, 8.0],
    "none": [np.nan] * 5,
}


@pytest.mark.parametrize("name", TIMES)
def test_points_survive(name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    case = points(TIMES[name])
    path.write_bytes(openep.encode(marker(), case))
    np.testing.assert_array_equal(read_surface(path).vertices, marker().vertices)
    back = openep.read_points(path, path.read_bytes())
    eam, sites = case.of("eam"), case.of("ablation")
    np.testing.assert_array_equal(back.type, [*eam.type, *sites.type])
    np.testing.assert_array_equal(back.xyz, np.vstack([eam.xyz, sites.xyz]))
    for column in ("bipolar", "unipolar"):
        np.testing.assert_array_equal(back.columns[column][:5], eam.columns[column])
    if name == "none":
        assert "lat" not in back.columns
    else:
        off = HALF_A_SAMPLE if name.startswith("parts") else 0.0
        np.testing.assert_allclose(back.columns["lat"][:5], TIMES[name], rtol=0, atol=off + 1e-9)


def electric(data: bytes, folder: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    (folder / "b.mat").write_bytes(data)
    found = loadmat(folder / "b.mat", squeeze_me=True, simplify_cells=True)["userdata"]["electric"]
    assert isinstance(found, dict)
    return found


@pytest.mark.parametrize("name", TIMES)
def test_openep_finds_voltages_and_times_at_the_points(name: str, tmp_path: Path) -> None:
    case = points(TIMES[name])
    found = electric(openep.encode(marker(), case), tmp_path)
    egm, notes = found["egm"], found["annotations"]
    eam = case.of("eam")
    has_signal = ~np.isnan(egm).all(axis=1)
    np.testing.assert_array_equal(has_signal, np.isfinite(eam.columns["bipolar"]))
    to_ms = 1000.0 / found["sampleFrequency"]
    window, reference, local = (
        notes[key].astype(int) * to_ms for key in ("woi", "referenceAnnot", "mapAnnot")
    )
    window = window + reference[:, None] + [-BUFFER, BUFFER]
    within = (local >= window[:, 0]) & (local <= window[:, 1])
    np.testing.assert_array_equal(within, np.isfinite(TIMES[name]))
    np.testing.assert_allclose(
        (local - reference)[within], np.array(TIMES[name])[within], rtol=0, atol=HALF_A_SAMPLE + 1e-9
    )
    # it compares the number of the sample with the window in ms
    samples = np.arange(egm.shape[1])
    assert ((samples >= window[:, :1]) & (samples <= window[:, 1:])).all()
    voltage = np.ptp(egm[has_signal], axis=1)
    np.testing.assert_array_equal(voltage, eam.columns["bipolar"][has_signal])
    np.testing.assert_array_equal(found["voltages"]["unipolar"], eam.columns["unipolar"])
    np.testing.assert_array_equal(found["include"], np.ones(5))


def test_openep_finds_every_member_that_it_asks_for(tmp_path: Path) -> None:
    shell = electric(openep.write(openep.read(tmp_path, openep.encode(marker(), None))), tmp_path)
    full = electric(openep.encode(marker(), points([1.0, 2, 3])), tmp_path)
    assert shell["egm"].size == shell["egmUni"].size == 0  # so that it reads no points
    arrays = "egmX egm egmUni egmUniX egmRef ecg egmSurfX barDirection include electrodeNames_bip"
    for name in (*arrays.split(), "electrodeNames_uni", "tags", "names"):
        assert isinstance(full[name], np.ndarray), name
    for name in ("time", "value"):
        assert isinstance(full["impedances"][name], np.ndarray)
    assert full["names"].tolist() == ["P1", "P2", "P3"]
    assert all(np.size(tag) == 0 for tag in full["tags"])  # any text would make the point a landmark


def test_values_of_ablation_sites_are_kept(tmp_path: Path) -> None:
    from scipy.io import loadmat

    case = points([1.0, 2, 3])
    (tmp_path / "a.mat").write_bytes(openep.encode(marker(), case))
    tag = loadmat(tmp_path / "a.mat", squeeze_me=True, simplify_cells=True)["userdata"]["rfindex"]["tag"]
    np.testing.assert_array_equal(tag["X"], case.of("ablation").xyz)
    np.testing.assert_array_equal(tag["avgForce"], [11.0, 12.5])
    for name in ("time", "maxTemp", "maxPower", "fti"):
        np.testing.assert_array_equal(tag[name], [np.nan, np.nan])
    few = Points(case.of("eam").xyz, np.full(3, "eam"))
    (tmp_path / "a.mat").write_bytes(openep.encode(marker(), few))
    assert "rfindex" not in loadmat(tmp_path / "a.mat", simplify_cells=True)["userdata"]


def test_a_time_that_carto_left_out_is_missing(tmp_path: Path) -> None:
    annotations = {"mapAnnot": np.array([2010.0, -10000, 1990]), "referenceAnnot": np.full(3, 2000.0)}
    tree = {"electric": {"egmX": np.arange(9.0).reshape(3, 3), "annotations": annotations}}
    back = openep.read_points(tmp_path / "a.mat", openep.save(tree))
    np.testing.assert_array_equal(back.columns["lat"], [10, np.nan, -10])
