"""Find every sentence of the program that advises a user to do something, by the syntax of its source."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from o3dls.cli.commands import cli

ROOT = Path(__file__).resolve().parents[2]
OPTION = re.compile(r"(?<![\w-])--(?:\{\}|[a-z][a-z-]+)")
COMMAND = re.compile(r"o3dls (\w+)")
SAID = re.compile(
    r"\b[Ss]ay\b|\bomit\b|\brun (?:it|them|again|there|the case|a pipeline)\b|\bpip install\b"
    r"|\bthe stage global_pose\b|\bengine '|\buse case_of\b"
)
# a line of a file, or a keyword: `cap = true`, `units='mm'`
LINE = re.compile(r"\b[a-z_]+ ?= ?(?:[\"'{\[]|true|false|True|\d)|case\.toml")
VERB = re.compile(r"\b(?:add|correct|give|leave|name|omit|put|raise|remove|set|state|take|use|write)\b")
HELP = ("help", "description", "epilog")  # keywords whose values describe options and parameters


def strings() -> Iterator[tuple[str, int, str]]:
    """The strings of the program, each with its module and line, and what is filled in as {}; no docstrings
    and no help.
    """
    for path in sorted((ROOT / "o3dls").rglob("*.py")):
        name = path.relative_to(ROOT / "o3dls").with_suffix("").as_posix()
        tree = ast.parse(path.read_text(encoding="utf-8"))
        nodes = list(ast.walk(tree))
        skipped = {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
        skipped |= {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
        skipped |= {id(node.value) for node in nodes if isinstance(node, ast.keyword) and node.arg in HELP}
        for node in nodes:
            text = None if id(node) in skipped else string_of(node)
            if text is not None:
                yield name, node.lineno, text  # type: ignore[attr-defined]  # strings have a line


def string_of(node: ast.AST) -> str | None:
    if isinstance(node, ast.JoinedStr):
        return "".join(str(p.value) if isinstance(p, ast.Constant) else "{}" for p in node.values)
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def advises(text: str) -> bool:
    """Whether a text names an option or a command, says what to say or to run, or what to do with a line of a
    file or a keyword.
    """
    return " " in text and bool(
        OPTION.search(text)
        or set(COMMAND.findall(text)) & set(cli.commands)
        or SAID.search(text)
        or (LINE.search(text) and VERB.search(text))
    )
