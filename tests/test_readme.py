"""What the README shows is executed, in its order and in one folder; `<!-- not run: reason -->` above a block
spares it.
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
BLOCKS = [match.groupdict() for match in BLOCK.finditer(README) if not match["spared"]]


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
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("readme")


@pytest.mark.slow
@pytest.mark.parametrize("block", BLOCKS, ids=[f"{i}-{block['language']}" for i, block in enumerate(BLOCKS)])
def test_blocks_run(block: dict[str, str], folder: Path) -> None:
    execute(block["language"], block["code"], folder)


def test_every_fenced_block_is_found() -> None:
    assert len(list(BLOCK.finditer(README))) == README.count("\n```") // 2
    assert {block["language"] for block in BLOCKS} == {"python", "sh", "toml"}


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
    assert "one minute instead of three" in " ".join(help_text.split())
    section = README.partition("## The paper's experiments")[2].partition("\n## ")[0]
    assert set(re.findall(r"(\w+) minutes?\b", section)) == {"three"}


def test_which_paper_this_is_is_said_once() -> None:
    pages = [README, *(path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*.md"))]
    assert sum(page.count("without title and authors") for page in pages) == 1
