"""List every installed distribution with its licence (CycloneDX, build/sbom.json), and check the licences.

python tools/licences.py        # needs cyclonedx-bom; ends with 1 where a licence is missing or not wanted
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterable, Mapping
from importlib.metadata import Distribution, distributions
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "build" / "sbom.json"
GPL = re.compile(r"\bA?GPL|GNU (Affero )?General Public", re.IGNORECASE)  # not the LGPL
FILE = re.compile(r"(LICEN[CS]E|COPYING)[^/]*", re.IGNORECASE)
# what may be under the GPL all the same, and why
EXCEPTIONS = {"pymeshlab": "GPL-3; a given dependency, see the README"}


def licence(distribution: Distribution) -> str:
    """What a distribution says of its licence: the expression, the classifiers, the first line of the text;
    else the name of a file that holds it; empty where it says nothing.
    """
    facts = distribution.metadata
    classifiers = [line for line in facts.get_all("Classifier") or [] if line.startswith("License ::")]
    text = (facts.get("License") or "").strip().partition("\n")[0]
    said = (
        facts.get("License-Expression") or ", ".join(line.split(" :: ")[-1] for line in classifiers) or text
    )
    return said or next((str(path) for path in distribution.files or [] if FILE.fullmatch(path.name)), "")


def required(name: str, installed: Mapping[str, Distribution]) -> set[str]:
    """Names of what a distribution needs without any extra, and of what that needs; itself too."""
    found: set[tuple[str, frozenset[str]]] = set()
    open_ = [(canonicalize_name(name), frozenset[str]())]
    while open_:
        key, extras = here = open_.pop()
        if here in found or key not in installed:  # what is not installed is for another system
            continue
        found.add(here)
        for need in map(Requirement, installed[key].requires or []):
            asked = need.marker is None or any(need.marker.evaluate({"extra": e}) for e in extras | {""})
            open_ += [(canonicalize_name(need.name), frozenset(need.extras))] if asked else []
    return {key for key, _ in found}


def faults(installed: Iterable[Distribution], name: str = "o3dls") -> list[str]:
    """What is wrong with the licences of what is installed, one sentence each."""
    known = {canonicalize_name(one.name): one for one in installed}
    found = [f"{key}: says nothing of its licence" for key in sorted(known) if not licence(known[key])]
    return found + [
        f"{key}: is required by {name} and under {licence(known[key])}; replace it"
        for key in sorted(required(name, known))
        if GPL.search(licence(known[key])) and key not in EXCEPTIONS
    ]


def bill(installed: Iterable[Distribution]) -> dict[str, Any]:
    """The CycloneDX bill of this environment; a component that came without a licence has what `licence`
    finds.
    """
    command = ["-m", "cyclonedx_py", "environment", "--output-reproducible", "--pyproject"]
    done = subprocess.run(
        [sys.executable, *command, str(ROOT / "pyproject.toml"), sys.executable],
        stdout=subprocess.PIPE,
        check=True,
    )
    found: dict[str, Any] = json.loads(done.stdout)
    said = {canonicalize_name(one.name): licence(one) for one in installed}
    for component in found["components"]:
        if not component.get("licenses") and (text := said.get(canonicalize_name(component["name"]))):
            component["licenses"] = [{"license": {"name": text}}]
    return found


def main() -> str:
    """Write the bill; gives what is wrong."""
    installed = list(distributions())
    OUT.parent.mkdir(exist_ok=True)
    OUT.write_text(json.dumps(bill(installed), indent=1), encoding="utf-8")
    sys.stdout.write(f"{OUT.relative_to(ROOT)}: {len(installed)} distributions\n")
    return "\n".join(faults(installed))


if __name__ == "__main__":
    sys.exit(main() or None)
