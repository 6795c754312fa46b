"""Rewrite the tables of the method's numbers and of docs/files.md: what stands between `<!-- o3dls ... -->`
and `<!-- end -->` is what that command prints.

python tools/method_tables.py
"""

from __future__ import annotations

import re
from pathlib import Path

from click.testing import CliRunner

from o3dls.cli.commands import cli

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGES = [DOCS / name for name in ("method_settings.md", "method_parameters.md", "files.md")]
MARKED = re.compile(r"<!-- o3dls (?P<command>.+?) -->\n.*?<!-- end -->", re.DOTALL)


def printed(command: str) -> str:
    """What `o3dls COMMAND` prints. Raises SystemExit where it fails."""
    done = CliRunner().invoke(cli, command.split())
    if done.exit_code:
        raise SystemExit(f"o3dls {command}: {done.exception}")
    return done.stdout.strip()


def rewritten(page: str) -> str:
    """The text of a page with its tables as they are now."""

    def block(found: re.Match[str]) -> str:
        command = found["command"]
        return f"<!-- o3dls {command} -->\n\n{printed(command)}\n\n<!-- end -->"

    return MARKED.sub(block, page)


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(rewritten(page.read_text(encoding="utf-8")), encoding="utf-8")
