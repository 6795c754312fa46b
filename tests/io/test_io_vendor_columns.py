"""An import ends with what became of each column of the vendor's own tables."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from said import said_by

from o3dls.io.matlab import openep
from tests.io.test_io_ensite_rows import XYZ, rows
from tests.io.test_io_study import DXL, carto_folder, openep_tree


def table_of(study: Path, out: Path, *options: str) -> dict[str, str]:
    """The table at the end of what an import prints."""
    code, said = said_by("import", study, out, *options)
    assert code == 0, said
    lines = said.splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("column of the points "))
    assert lines[-1] == str(out)
    at = lines[start].index("became")
    return {line[:at].strip(): line[at:] for line in lines[start + 1 : -1]}


def test_columns_of_carto(tmp_path: Path) -> None:
    found = table_of(carto_folder(tmp_path / "study"), tmp_path / "case", "--map", "1-Map")
    assert found["_car.txt, column 5"] == "taken as x"
    assert found["_car.txt, column 12"] == "taken as bipolar"
    assert found["_car.txt, column 8"] == found["_car.txt, columns from 15"] == "left"
    assert found["Sites.txt, Z"] == "taken as z"
    assert found["Sites.txt, AverageForce"] == "taken as force"
    assert found["Sites.txt, Session"] == "left"


def test_columns_of_carto_without_their_table_are_not_said(tmp_path: Path) -> None:
    study = carto_folder(tmp_path / "study")
    (study / "1-Map_car.txt").unlink()
    xml = study / "Study 1.xml"
    text = xml.read_text(encoding="cp1252")
    placed = re.sub(r'(<Point [^>]*?)( Position3D="[^"]*")?(/?>)', r'\1 Position3D="1 2 3"\3', text)
    xml.write_text(placed, encoding="cp1252")
    found = table_of(study, tmp_path / "case", "--map", "1-Map")
    assert not any(heading.startswith("_car.txt") for heading in found)


def test_columns_of_ensite(tmp_path: Path) -> None:
    (tmp_path / "study").mkdir()
    (tmp_path / "study/Map_PP_bi.csv").write_text(DXL)
    found = table_of(tmp_path / "study", tmp_path / "case")
    assert found["Map_PP_bi.csv, roving x"] == "taken as x"
    assert found["Map_PP_bi.csv, P-P"] == "taken as bipolar"
    assert found["Map_PP_bi.csv, P-P valid"] == "taken to leave out values that are not"
    assert found["Map_PP_bi.csv, utilized"] == "taken to choose the points that the map uses"
    assert "left" in found.values()


@pytest.mark.parametrize("axes", ["x,y,z", "X,Y,Z"])
@pytest.mark.parametrize("name", ["Lesions.csv", "AutoMark_Data.csv"])
@pytest.mark.parametrize("off", [0.0, 200.0])
def test_ablation_points_of_ensite(off: float, name: str, axes: str, tmp_path: Path) -> None:
    """Those that are of another chamber are not taken, and so are their columns."""
    (tmp_path / "study").mkdir()
    (tmp_path / "study/Map_PP_bi.csv").write_text(DXL)
    head = f"Text,{axes},Avg Contact Force (g),Energy,Diameter"
    (tmp_path / f"study/{name}").write_text(f"{head}\nL1,{1.5 + off},2.5,3.5,12,300,4\nEOF\n")
    found = table_of(tmp_path / "study", tmp_path / "case")
    own = {heading: became for heading, became in found.items() if heading.startswith(name)}
    first, _, last = axes.split(",")
    became = {
        f"{name}, Text": "left",
        f"{name}, {first}": "taken as x",
        f"{name}, {last}": "taken as z",
        f"{name}, Avg Contact Force (g)": "taken as force",
        f"{name}, Energy": "taken as energy_j",
        f"{name}, Diameter": "left",
    }
    assert became.items() <= own.items() if off == 0.0 else not own


def test_rows_of_an_older_ensite(tmp_path: Path) -> None:
    (tmp_path / "study").mkdir()
    (tmp_path / "study/DxL_1.csv").write_text(rows(XYZ))
    found = table_of(tmp_path / "study", tmp_path / "case")
    assert found["DxL_1.csv, peak2peak"] == "taken as bipolar"
    assert found["DxL_1.csv, rov LAT"] == "taken as lat, less ref LAT, times 1000"
    assert found["DxL_1.csv, surfPt x"] == found["DxL_1.csv, rov trace"] == "left"
    assert len(found) == 10


@pytest.mark.parametrize("tagged", [False, True])
def test_members_of_openep(tagged: bool, tmp_path: Path) -> None:
    tree = openep_tree()
    tree["electric"]["voltages"]["unipolar"] = np.full(3, np.nan)
    tree["electric"]["names"] = np.array(["P1", "P2", "P3"], dtype=object)
    if tagged:
        tree["electric"]["tags"] = np.array(["Scar", "", "Scar"], dtype=object)
    (tmp_path / "s.mat").write_bytes(openep.save(tree))
    found = table_of(tmp_path / "s.mat", tmp_path / "case")
    expected = {
        "electric.egmX": "taken as x, y, z",
        "electric.voltages.bipolar": "taken as bipolar",
        "electric.voltages.unipolar": "left",  # it holds no value
        "electric.annotations.mapAnnot": "taken as lat",
        "electric.names": "left",
        **({"electric.tags": "kept as text"} if tagged else {}),
    }
    assert expected.items() <= found.items()
    assert ("electric.tags" in found) is tagged
