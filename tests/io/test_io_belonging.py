"""Ablation sites belong to the map on whose chamber they lie; those of another are left, and counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from formats import car_file
from test_io_study import CARTO_XML, DXL

from o3dls.case import Points
from o3dls.geometry.surface import Surface
from o3dls.io.mapping.belonging import NEARER, REACH, Anatomy, of_one_map
from o3dls.io.mapping.study import read_study
from o3dls.io.matlab import openep
from o3dls.io.meshes.carto import mesh_file
from o3dls.io.meshes.surface_file import SurfaceFile

SEED = 91_407
LEFT, RIGHT = np.zeros(3), np.array([62.0, 0.0, 0.0])  # two chambers of radius 30 with a wall of 2 mm


def ball(middle: np.ndarray) -> Surface:
    found = trimesh.creation.icosphere(3, 30.0)
    return Surface(found.vertices + middle, np.array(found.faces))


def on(middle: np.ndarray, n: int, noise: float = 1.0) -> np.ndarray:
    rng = np.random.default_rng([SEED, n])
    xyz = rng.normal(size=(n, 3))
    return middle + 30.0 * xyz / np.linalg.norm(xyz, axis=1)[:, None] + rng.normal(0.0, noise, (n, 3))


def sites(*places: np.ndarray) -> Points:
    xyz = np.vstack(places)
    return Points(xyz, np.full(len(xyz), "ablation"), {"force": np.arange(float(len(xyz)))})


@pytest.mark.parametrize("shells", [True, False])
def test_neighbouring_chambers_share_out_the_sites(shells: bool) -> None:
    left, right = (Anatomy(on(m, 400), ball(m) if shells else None) for m in (LEFT, RIGHT))
    every = sites(on(LEFT, 60), on(RIGHT, 45))
    own, said = of_one_map(every, left, [right])
    other, _ = of_one_map(every, right, [left])
    shared = np.linalg.norm(every.xyz - [31.0, 0.0, 0.0], axis=1) < 15.0  # about the wall between them
    assert set(own.columns["force"]) >= set(np.arange(60.0))
    assert set(other.columns["force"]) >= set(np.arange(60.0, 105.0))
    assert shared[own.columns["force"].astype(int)[own.columns["force"] >= 60]].all()
    assert said.startswith(f"{105 - len(own)} of 105 ablation sites, which lie ")


def test_two_maps_of_one_chamber_both_have_its_sites() -> None:
    first, second = (
        Anatomy(on(LEFT, 300), ball(LEFT)),
        Anatomy(on(LEFT, 250), ball(LEFT + np.array([1.0, 0.0, 0.0]))),
    )
    assert of_one_map(sites(on(LEFT, 50, 0.5)), first, [second])[1] == ""
    assert NEARER > 2.0  # two maps of one chamber differ by noise


def test_far_sites_are_left_where_there_is_no_other_map() -> None:
    own, said = of_one_map(
        sites(on(LEFT, 10), on(LEFT + np.array([90.0, 0.0, 0.0]), 30)), Anatomy(on(LEFT, 90), ball(LEFT)), []
    )
    assert len(own) == 10
    assert "30 of 40 ablation sites" in said
    assert (
        of_one_map(sites(on(LEFT, 9)), Anatomy(np.zeros((0, 3))), [])[1] == ""
    )  # no chamber to compare with


def test_a_sparse_map_without_a_shell_reaches_over_its_gaps() -> None:
    few = Anatomy(on(LEFT, 8))
    assert few.reach > REACH
    assert len(of_one_map(sites(on(LEFT, 40)), few, [])[0]) > 36


def carto(folder: Path) -> Path:
    xml = CARTO_XML.replace('Name="2 empty µ"', 'Name="2-Map"').replace(
        '<CartoPoints Count="0" />', '<CartoPoints Count="1"><Point Id="1" /></CartoPoints>'
    )
    (folder / "VisiTagExport").mkdir(parents=True)
    for name, middle in (("1-Map", LEFT), ("2-Map", RIGHT)):
        (folder / f"{name}.mesh").write_bytes(mesh_file.write(SurfaceFile(ball(middle))))
        measured = Points(on(middle, 90), np.full(90, "eam"))
        (folder / f"{name}_car.txt").write_bytes(car_file(name, measured))
    (folder / "CT.mesh").write_bytes(mesh_file.write(SurfaceFile(ball(LEFT))))
    (folder / "Study 1.xml").write_text(xml.format(volume=1.0))
    return folder


def site_rows(xyz: np.ndarray) -> str:
    return "".join(" 0 0 {} {:.3f} {:.3f} {:.3f} 10 5 \n".format(k, *at) for k, at in enumerate(xyz))


@pytest.mark.parametrize("other", ["whole", "without its shell", "without its points", "damaged"])
def test_carto_sites_of_the_map_alone_are_imported(other: str, tmp_path: Path) -> None:
    folder = carto(tmp_path / "s")
    places = np.vstack([on(LEFT, 20), on(RIGHT, 15)])
    places = places[np.abs(places[:, 0] - 31.0) > 15.0]
    mine = int((places[:, 0] < 31.0).sum())
    rows = " Session ChannelID SiteIndex X Y Z DurationTime AverageForce \n" + site_rows(places)
    (folder / "VisiTagExport/Sites.txt").write_text(rows)
    if other in ("without its shell", "damaged"):
        (folder / "2-Map.mesh").write_bytes(b"damaged") if other == "damaged" else (
            folder / "2-Map.mesh"
        ).unlink()
    if other == "without its points":
        (folder / "2-Map_car.txt").unlink()
    found = read_study(folder, "1-Map")
    assert (found.points.type == "ablation").sum() == mine + 1  # one of its points is tagged so
    assert f"took {mine} ablation sites of VisiTag" in "\n".join(f"took {line}" for line in found.took)
    assert f"VisiTag: {len(places) - mine} of {len(places)} ablation sites" in "\n".join(found.left)


def test_lesions_of_ensite_and_of_openep_too(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a/map.csv").write_text(DXL)
    (tmp_path / "a/Lesions.csv").write_text("Text,x,y,z\nL1,1.5,2.5,3.5\nL2,100,2,3\nEOF\n")
    found = read_study(tmp_path / "a")
    assert (found.points.type == "ablation").sum() == 1
    assert "Lesions.csv: 1 of 2 ablation sites" in "\n".join(found.left)
    measured = Points(on(LEFT, 50), np.full(50, "eam"))
    every = Points(
        np.vstack([measured.xyz, on(LEFT, 5), on(LEFT + np.array([95.0, 0.0, 0.0]), 4)]),
        np.repeat(["eam", "ablation"], [50, 9]),
    )
    (tmp_path / "b.mat").write_bytes(openep.encode(ball(LEFT), every))
    found = read_study(tmp_path / "b.mat")
    assert (found.points.type == "ablation").sum() == 5
    assert "4 of 9 ablation sites" in "\n".join(found.left)


def test_the_reported_study(shared_data: Path) -> None:
    folder = shared_data / "reports/02-ablation-of-another-chamber/study"
    if not folder.is_dir():
        pytest.skip(f"no folder {folder}")
    found = read_study(folder)
    assert (found.points.type == "ablation").sum() == 10
    assert "30 of 40 ablation sites" in "\n".join(found.left)
