"""What our pages may do: links lead to pages, and the policy lets run our own scripts and nothing else."""

from __future__ import annotations

import base64
import hashlib
import html
import os
import re
import urllib.parse
from collections import Counter
from pathlib import Path

import pytest

from o3dls.paper.blocks import Figure, Heading
from o3dls.paper.page import STYLE
from o3dls.report.document import document
from o3dls.report.markup import Html, join, tag
from o3dls.report.page import report_page
from o3dls.report.page_parts import SCRIPTS, asset
from o3dls.report.subject import read_subject
from o3dls.report.writer import compare
from tests.browser import Visit, chromium
from tests.finished import finished

NAMES = ["javascript:alert(1)", "a?b#c", "100%", "50 %41", 'q"uote', os.fsdecode(b"F\xfcr")]
PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)
SMUGGLED = """<script>document.title = 'bad'</script><img src="x" onerror="document.title = 'bad'">
<a id="link" href="javascript:document.title = 'bad'">x</a><base href="https://example.org/">
<style>body { display: none }</style><p id="p" style="display: none">x</p>"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(tmp_path_factory.mktemp("policy") / "run")


@pytest.mark.parametrize("name", NAMES)
def test_a_link_leads_to_the_report_of_a_folder_of_any_name(name: str, tmp_path: Path) -> None:
    folder = finished(tmp_path / name)
    (folder / "report.html").write_text("")
    text = compare([folder], tmp_path / "all.html").read_text(encoding="utf-8")
    (link,) = set(re.findall('href="([^"#]+)"', text))  # of the name and of the marks
    assert urllib.parse.urlsplit(link).scheme == ""
    assert tmp_path / os.fsdecode(urllib.parse.unquote_to_bytes(link)) == folder / "report.html"


@pytest.mark.parametrize(
    "address",
    ["javascript:alert(1)", " JavaScript:x", "java\nscript:x", "data:text/html,x", "vbscript:x", "x:y"],
)
def test_no_element_leads_to_what_runs(address: str) -> None:
    for key in ("href", "src"):
        with pytest.raises(ValueError, match=f"{key} = .* must be relative"):
            tag("a", "text", **{key: address})
    for good in ("#made", "a/b.html", "../x%3Ay", "https://doi.org/x:y", "a?b:c", "data:image/png;base64,AA"):
        assert good in tag("a", "text", href=good)


def policy_of(text: str) -> dict[str, str]:
    """The directives of a page's content security policy."""
    (content,) = re.findall('http-equiv="Content-Security-Policy" content="([^"]+)"', text)
    rules = (tuple(rule.split(" ", 1)) for rule in html.unescape(content).split("; "))
    return dict(rules)


def test_every_page_runs_its_own_scripts_and_nothing_else(run: Path, tmp_path: Path) -> None:
    pages = {
        "report": report_page(read_subject([run])),
        "compare": compare([run], tmp_path / "all.html").read_text(encoding="utf-8"),
        "paper": document("paper", "p{}", tag("p", "text")),
    }
    for name, text in pages.items():
        rules = policy_of(text)
        assert rules["default-src"] == "'none'"
        assert not re.search(r" style=| on\w+=", re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL))
        for kind in ("script", "style"):
            found = [t.encode() for t in re.findall(rf"<{kind}>(.*?)</{kind}>", text, re.DOTALL)]
            hashes = {f"'sha256-{base64.b64encode(hashlib.sha256(t).digest()).decode()}'" for t in found}
            assert set(rules.get(f"{kind}-src", "").split()) == hashes, name
    assert "script-src" not in policy_of(pages["paper"])


def test_a_script_that_is_not_ours_has_no_hash() -> None:
    body = join(tag("script", Html("ours()")), tag("script", Html("theirs()")))
    assert len(policy_of(document("t", "", body, ["ours()"]))["script-src"].split()) == 1


def test_in_a_browser_what_was_smuggled_in_does_nothing(run: Path, tmp_path: Path) -> None:
    page = compare([run], tmp_path / "all.html")
    text = page.read_text(encoding="utf-8")
    page.write_text(text.replace("</main>", f"{SMUGGLED}</main>"), encoding="utf-8")
    with chromium() as launch:
        visit = Visit(launch(), page, wait=False)
        visit.page.click("#link")
        assert visit.page.title() == "1 case, 1 run compared"
        assert visit.page.is_visible("#p")
        assert all(url.startswith("file:") for url in visit.requests)
        assert len(visit.errors) >= 5  # each is refused by the policy, and said
        assert all("Content Security Policy" in error for error in visit.errors)


def test_in_a_browser_the_page_of_the_paper_has_its_style_and_pictures(tmp_path: Path) -> None:
    blocks = [Heading("The paper", 1), Figure("noise", "a picture", PIXEL)]
    page = tmp_path / "index.html"
    page.write_text(document("paper", STYLE, join(*(block.html() for block in blocks))), encoding="utf-8")
    with chromium() as launch:
        visit = Visit(launch(), page, wait=False)
        assert visit.errors == []
        assert visit.page.evaluate("document.images[0].naturalWidth") == 1
        assert visit.page.evaluate("getComputedStyle(document.body).maxWidth") != "none"


def test_the_scripts_of_the_viewer_share_no_name() -> None:
    """They stand in one script: of two functions of one name the first would be lost without a word."""
    names = [
        name
        for script in ("page.js", *SCRIPTS)
        for name in re.findall(r"^(?:(?:async )?function|const|let) (\w+)", asset(script), re.MULTILINE)
    ]
    assert len(names) > 100
    assert [name for name, count in Counter(names).items() if count > 1] == []
