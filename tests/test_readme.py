"""What README and docs show is executed, page by page, in its order and in one folder;
`<!-- not run: reason -->` above a block spares it.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from conftest import ROOT

from o3dls.cli.commands import cli

BLOCK = re.compile(
    r"(?P<spared><!-- not run: [^\n]+ -->\n)?```(?P<language>\w+)\n(?P<code>.*?)```", re.DOTALL
)
README = (ROOT / "README.md").read_text(encoding="utf-8")
EXECUTED = ("README.md", "docs/python.md", "docs/pipelines.md", "docs/architecture.md")
BLOCKS = [
    (page, match.groupdict())
    for page in EXECUTED
    for match in BLOCK.finditer((ROOT / page).read_text(encoding="utf-8"))
    if not match["spared"]
]


def execute(language: str, code: str, folder: Path) -> None:
    """Run a block of sh or python in a folder; a toml block becomes the file that its first line names."""
    if language == "toml":
        (folder / code.splitlines()[0].removeprefix("# ")).write_text(code, encoding="utf-8")
        return
    command = {"python": [sys.executable, "-c", code], "sh": ["sh", "-eu", "-c", code]}[language]
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    env = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{code}\n{done.stdout}\n{done.stderr}"


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {page: tmp_path_factory.mktemp(Path(page).stem) for page in EXECUTED}


@pytest.mark.parametrize(
    ("page", "block"),
    BLOCKS,
    ids=[f"{page}-{i}-{block['language']}" for i, (page, block) in enumerate(BLOCKS)],
)
def test_blocks_run(page: str, block: dict[str, str], folders: dict[str, Path]) -> None:
    execute(block["language"], block["code"], folders[page])


@pytest.mark.parametrize("page", EXECUTED)
def test_every_fenced_block_is_found(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    assert len(list(BLOCK.finditer(text))) == text.count("\n```") // 2
    assert {block["language"] for _, block in BLOCKS} == {"python", "sh", "toml"}


def test_the_readme_is_short_enough_to_be_read() -> None:
    assert README.count("\n") <= 150


def test_the_two_commands_stand_at_the_top() -> None:
    first = BLOCK.search(README)
    assert first is not None
    assert [line.split("#")[0].strip() for line in first["code"].splitlines()] == ["./dev demo", "./dev test"]
    assert README[: first.start()].count("\n") < 5


def test_the_environment_is_activated_before_any_other_block() -> None:
    """`./dev` installs into .venv, of which a shell knows nothing by itself."""
    _, second, *others = BLOCK.finditer(README)
    assert ". .venv/bin/activate" in second["code"]
    assert any(block["language"] == "python" for block in others)


def test_one_time_is_said_of_the_experiments_of_the_paper() -> None:
    help_text = CliRunner().invoke(cli, ["paper", "--help"]).output
    assert "about one minute instead of six" in " ".join(help_text.split())
    section = README.partition("## The paper's experiments")[2].partition("\n## ")[0]
    assert set(re.findall(r"(\w+) minutes?\b", section)) == {"six"}


def test_which_paper_this_is_is_said_once() -> None:
    pages = [README, *(path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*.md"))]
    assert sum(page.count("without title and authors") for page in pages) == 1
