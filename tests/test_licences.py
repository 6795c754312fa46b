"""tools/licences.py: what is required says its licence, and only one of it is under the GPL."""

from __future__ import annotations

import runpy
from collections.abc import Sequence
from importlib.metadata import Distribution, distributions
from pathlib import Path

import pytest
from conftest import ROOT
from packaging.utils import canonicalize_name

LICENCES = runpy.run_path(str(ROOT / "tools" / "licences.py"))


def environment(folder: Path, *packages: tuple[str, Sequence[str]]) -> list[Distribution]:
    """Distributions with a name and further lines of their metadata."""
    for name, lines in packages:
        info = folder / f"{name}-1.0.dist-info"
        info.mkdir()
        head = ["Metadata-Version: 2.4", f"Name: {name}", "Version: 1.0"]
        (info / "METADATA").write_text("\n".join([*head, *lines, "", ""]))
        (info / "RECORD").write_text("")
    return list(distributions(path=[str(folder)]))


def test_every_package_here_has_a_licence_and_none_that_is_required_an_unwanted_one() -> None:
    here = list(distributions())
    assert LICENCES["faults"](here) == []
    known = {canonicalize_name(one.name): one for one in here}
    needed = LICENCES["required"]("o3dls", known)
    assert {"numpy", "pymeshlab", "dash", "llvmlite"} <= needed  # of our own, and of theirs
    assert not needed & {"pytest", "sphinx", "vtk"}  # of extras
    # the exception is needed, and has the licence that the README says
    assert LICENCES["EXCEPTIONS"].keys() == {"pymeshlab"}
    assert LICENCES["licence"](known["pymeshlab"]).startswith("GPL3")


@pytest.mark.parametrize(
    ("said", "unwanted"),
    [
        ("License-Expression: GPL-3.0-or-later", True),
        ("License: AGPLv3", True),
        ("Classifier: License :: OSI Approved :: GNU General Public License v3 (GPLv3)", True),
        ("License: GNU Affero General Public License", True),
        ("License-Expression: LGPL-2.1-only", False),
        ("Classifier: License :: OSI Approved :: GNU Lesser General Public License v3 (LGPLv3)", False),
        ("License: MIT", False),
    ],
)
def test_the_gpl_is_told_from_other_licences(said: str, unwanted: bool, tmp_path: Path) -> None:
    tool = ("License: MIT", "Requires-Dist: part", "Requires-Dist: other; extra == 'x'")
    here = environment(tmp_path, ("tool", tool), ("part", [said]), ("other", ["License: GPL"]))
    found = LICENCES["faults"](here, "tool")
    assert [fault.partition(":")[0] for fault in found] == (["part"] if unwanted else [])


def test_an_extra_of_a_requirement_and_what_is_not_installed(tmp_path: Path) -> None:
    here = environment(
        tmp_path,
        ("tool", ["License: MIT", "Requires-Dist: part[x]", "Requires-Dist: absent"]),
        ("part", ["License: MIT", "Requires-Dist: other; extra == 'x'", "Requires-Dist: tool"]),
        ("other", ["License: GPL"]),
    )
    assert LICENCES["faults"](here, "tool") == ["other: is required by tool and under GPL; replace it"]


def test_a_package_that_says_nothing_is_named_unless_it_has_a_file(tmp_path: Path) -> None:
    here = environment(tmp_path, ("bare", []), ("filed", []))
    (tmp_path / "filed-1.0.dist-info/RECORD").write_text("filed-1.0.dist-info/licenses/LICENSE.txt,,\n")
    (tmp_path / "filed-1.0.dist-info/licenses").mkdir()
    (tmp_path / "filed-1.0.dist-info/licenses/LICENSE.txt").touch()  # what is not there, some leave out
    assert LICENCES["faults"](here) == ["bare: says nothing of its licence"]


def test_the_bill_names_every_package_with_its_licence() -> None:
    pytest.importorskip("cyclonedx_py", reason="cyclonedx-bom is not installed")
    here = list(distributions())
    bill = LICENCES["bill"](here)
    assert bill["bomFormat"] == "CycloneDX"
    named = {canonicalize_name(component["name"]): component for component in bill["components"]}
    assert not {canonicalize_name(one.name) for one in here} - {"o3dls"} - named.keys()
    assert all(component["licenses"] for name, component in named.items() if name != "o3dls")
    assert named["pymeshlab"]["licenses"] == [{"license": {"name": "GPL3"}}]
