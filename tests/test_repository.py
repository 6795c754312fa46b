"""What stands around the package: the workflow of the host, and the pages that it shows."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from test_packaging import PROJECT

GITHUB = ROOT / ".github"
WORKFLOW = GITHUB / "workflows" / "test.yml"
TOP = {
    *("pyproject.toml", "constraints.txt", "README.md", "LICENSE", "CHANGELOG.md", "CITATION.cff"),
    *("o3dls", "pipelines", "tests", "data_synth", "benchmarks", "docs", "tools"),
    *("dev", ".ci", ".github", ".gitignore"),
}
LINK = re.compile(r"\]\(([^)#:]+)(#[\w-]+)?\)")


def load(path: Path) -> Any:
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def test_the_workflow_calls_the_command_of_the_readme_on_every_python() -> None:
    workflow = load(WORKFLOW)
    assert workflow.keys() == {"name", "on", "permissions", "jobs"}
    assert workflow["on"].keys() == {"push", "pull_request"}
    (job,) = workflow["jobs"].values()
    assert job.keys() >= {"runs-on", "strategy", "steps"}
    assert job["strategy"]["matrix"]["python"] == ["3.11", "3.12", "3.13", "3.14"]
    assert PROJECT["project"]["requires-python"] == ">=3.11"
    for step in job["steps"]:
        assert len({"uses", "run"} & step.keys()) == 1
        assert re.fullmatch(r"actions/[a-z-]+@v\d+", step.get("uses", "actions/checkout@v4"))
    assert [step["run"] for step in job["steps"] if "run" in step] == ["./dev test"]
    # `./dev` takes the interpreter from there
    assert job["env"]["PYTHON"] == "python"
    assert "${PYTHON:-" in (ROOT / "dev").read_text()


@pytest.mark.parametrize("name", ["bug", "wish"])
def test_issue_templates_have_the_head_that_the_host_reads(name: str) -> None:
    text = (GITHUB / "ISSUE_TEMPLATE" / f"{name}.md").read_text(encoding="utf-8")
    _, head, body = text.split("---\n", 2)
    keys = dict(line.split(": ", 1) for line in head.splitlines())
    assert keys.keys() == {"name", "about", "labels"}
    assert "data of patients" in body


@pytest.mark.parametrize("name", ["CONTRIBUTING.md", "CODE_OF_CONDUCT.md", "SECURITY.md"])
def test_links_of_the_pages_lead_somewhere(name: str) -> None:
    text = (GITHUB / name).read_text(encoding="utf-8")
    for path, heading in LINK.findall(text):
        target = GITHUB / path
        assert target.is_file(), path
        titles = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.MULTILINE)
        anchors = {"#" + re.sub(r"[^\w-]", "", title.lower().replace(" ", "-")) for title in titles}
        assert not heading or heading in anchors


def test_the_top_of_the_repository_stays_short() -> None:
    done = subprocess.run(
        ["git", "ls-tree", "--name-only", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if done.returncode:
        pytest.skip("no clone of git")
    assert set(done.stdout.split()) <= TOP
