"""What stands around the package: the workflow of the host, and the pages that it shows."""

from __future__ import annotations

import ast
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from test_packaging import PROJECT

from o3dls import __version__

GITHUB = ROOT / ".github"
ON = True  # the key `on`, as YAML 1.1 reads it
WORKFLOW = GITHUB / "workflows" / "test.yml"
TOP = {
    *("pyproject.toml", "constraints.txt", "README.md", "LICENSE", "CHANGELOG.md", "CITATION.cff"),
    *("o3dls", "pipelines", "tests", "data_synth", "benchmarks", "docs", "tools"),
    *("dev", ".ci", ".github", ".gitignore", ".pre-commit-config.yaml"),
}
LINK = re.compile(r"\]\(([^)#:]+)(#[\w-]+)?\)")
MOST_ARGUMENTS = 6  # besides self and cls
LONG_FUNCTIONS = 15  # that may have more: mostly commands, and public functions that take options by name


def load(path: Path) -> Any:
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def test_the_workflow_calls_the_command_of_the_readme_on_every_python() -> None:
    workflow = load(WORKFLOW)
    assert workflow.keys() == {"name", ON, "permissions", "concurrency", "jobs"}
    assert workflow[ON].keys() == {"push", "pull_request", "workflow_dispatch"}
    (job,) = workflow["jobs"].values()
    assert job.keys() >= {"runs-on", "strategy", "steps"}
    assert job["strategy"]["matrix"]["python"] == ["3.11", "3.12", "3.13", "3.14"]
    assert PROJECT["project"]["requires-python"] == ">=3.11"
    for step in job["steps"]:
        assert len({"uses", "run"} & step.keys()) == 1
        assert re.fullmatch(r"actions/[a-z-]+@v\d+", step.get("uses", "actions/checkout@v4"))
    assert [step["run"] for step in job["steps"] if "run" in step] == [
        "./dev test --all",
        "./dev fuzz --seconds 60",
    ]
    # `./dev` takes the interpreter from there
    assert job["env"]["PYTHON"] == "python"
    assert "${PYTHON:-" in (ROOT / "dev").read_text()


def test_the_workflow_can_neither_write_nor_be_told_what_to_run() -> None:
    """The reason to do without a checker of workflows; see SEC001 in pyproject.toml."""
    workflow = load(WORKFLOW)
    assert list(WORKFLOW.parent.iterdir()) == [WORKFLOW]
    assert workflow["permissions"] == {"contents": "read"}
    assert workflow[ON]["workflow_dispatch"] is None  # no input
    (job,) = workflow["jobs"].values()
    assert "permissions" not in job
    checkout = next(step for step in job["steps"] if step.get("uses", "").startswith("actions/checkout"))
    assert checkout["with"] == {"persist-credentials": False}
    used = set(re.findall(r"\$\{\{ *([\w.]+) *\}\}", WORKFLOW.read_text(encoding="utf-8")))
    assert used == {"github.workflow", "github.ref", "matrix.python"}


def test_repo_review_has_nothing_against_the_repository() -> None:
    pytest.importorskip("sp_repo_review", reason="sp-repo-review is not installed")
    command = [sys.executable, "-m", "repo_review", str(ROOT), "--format", "json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    checks = json.loads(done.stdout)["checks"]
    assert len(checks) > 40
    assert not {name: check["err_msg"] for name, check in checks.items() if check["result"] is False}
    # what is ignored has a reason, and is a check that there is
    ignored = PROJECT["tool"]["repo-review"]["ignore"]
    assert all(len(reason.split()) > 3 for reason in ignored.values())
    assert not ignored.keys() & {name for name, check in checks.items() if check["result"]}


def test_the_hooks_call_tools_that_the_tests_install() -> None:
    config = load(ROOT / ".pre-commit-config.yaml")
    (local,) = config["repos"]
    installed = " ".join(PROJECT["project"]["optional-dependencies"]["test"])
    for hook in local["hooks"]:
        python, _, tool, *_ = hook["entry"].split()
        assert python == "python"
        assert f"{tool}>=" in installed


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


def test_the_changes_of_a_release_are_short_enough_to_be_read() -> None:
    _, *releases = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split("\n## ")
    assert releases[0].startswith(__version__)
    assert all(release.count("\n") <= 80 for release in releases)
    assert LINK.search(releases[0])  # details stand in the documentation


def test_the_top_of_the_repository_stays_short() -> None:
    git = shutil.which("git")
    if git is None or not (ROOT / ".git").exists():
        pytest.skip("no clone of git, or no git")
    done = subprocess.run(
        [git, "ls-tree", "--name-only", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert set(done.stdout.split()) <= TOP


def test_the_slow_tests_are_tests() -> None:
    listed = (ROOT / "tests/slow_tests.txt").read_text(encoding="utf-8").splitlines()
    assert listed == sorted(set(listed))
    for test in listed:
        file, *_, name = test.split("[")[0].split("::")
        assert f"def {name}(" in (ROOT / "tests" / file).read_text(encoding="utf-8"), test


def arguments_of(function: ast.FunctionDef | ast.AsyncFunctionDef) -> set[str]:
    """Names of the arguments of a function, without the object or class that it is a method of."""
    given = function.args
    named = (*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg)
    return {one.arg for one in named if one} - {"self", "cls"}


def test_arguments_that_belong_together_are_one() -> None:
    long = [
        f"{path.relative_to(ROOT)}:{node.lineno} {node.name}"
        for path in sorted((ROOT / "o3dls").rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and len(arguments_of(node)) > MOST_ARGUMENTS
    ]
    assert len(long) <= LONG_FUNCTIONS, "\n".join(long)


def test_what_browsers_wait_for_is_a_function() -> None:
    """An expression is evaluated again at every look, which the pages forbid: a test that has to look twice,
    as on a busy machine, would fail.
    """
    waits = re.compile(r"wait_for_function\(\s*f?[\"'](?!\(\) =>|\w+ =>)")
    found = [path for folder in ("tests", "tools", "benchmarks") for path in (ROOT / folder).rglob("*.py")]
    assert [path.name for path in found if waits.search(path.read_text(encoding="utf-8"))] == []
