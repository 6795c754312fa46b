"""The documentation builds as a site without a warning; its links lead somewhere, and it needs no network."""

from __future__ import annotations

import runpy
import subprocess
import sys
from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest
from conftest import ROOT

import o3dls
from o3dls.cli.commands import cli
from o3dls.report.writer import write_report
from tests.browser import Visit, chromium, violations
from tests.finished import finished

LOADS = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href"}


class Page(HTMLParser):
    """The links of a page, its anchors, and what it loads."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.anchors: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value for name, value in attrs if value}
        self.anchors.add(given.get("id", ""))
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        # a canonical address or a next page is not loaded
        loaded = tag != "link" or given.get("rel") in ("stylesheet", "icon", "preload", "preconnect")
        if tag in LOADS and loaded and LOADS[tag] in given:
            self.loads.append(given[LOADS[tag]])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for name in ("sphinx", "myst_parser", "furo", "sphinx_copybutton"):
        pytest.importorskip(name, reason=f"{name} is not installed: the site is not built")
    folder = tmp_path_factory.mktemp("site")
    report = write_report([finished(tmp_path_factory.mktemp("demo") / "run")])
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-q",
        "-W",
        "--keep-going",
        "-b",
        "html",
        "-D",
        f"demo_report={report}",
    ]
    done = subprocess.run(
        [*command, str(ROOT / "docs"), str(folder)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    return {path: Page(path) for path in site.rglob("*.html")}


@pytest.fixture(scope="module")
def launch() -> Iterator[Callable[..., Any]]:
    with chromium() as launch:
        yield launch


def test_every_page_of_the_documentation_is_in_the_navigation(pages: dict[Path, Page], site: Path) -> None:
    named = {urlsplit(link).path for link in pages[site / "index.html"].links}
    wanted = {f"{path.stem}.html" for path in (ROOT / "docs").glob("*.md")} - {"index.html"}
    assert len(wanted) > 10
    assert not wanted - named


def test_links_within_the_site_lead_to_a_file_and_a_place_in_it(pages: dict[Path, Page]) -> None:
    dead = []
    for path, page in pages.items():
        for link in page.links:
            found = urlsplit(link)
            if found.scheme in ("http", "https", "mailto"):
                continue
            target = (path.parent / unquote(found.path)).resolve() if found.path else path
            place = unquote(found.fragment)
            if not target.is_file() or (place and target in pages and place not in pages[target].anchors):
                dead.append((path.name, link))
    assert sum(len(page.links) for page in pages.values()) > 200
    assert not dead


def test_the_first_page_has_a_picture_six_cards_and_the_report_of_the_demo(
    pages: dict[Path, Page], site: Path, launch: Callable[..., Any]
) -> None:
    loads = pages[site / "index.html"].loads
    assert sum(load.endswith(".png") for load in loads) == 1 + 6
    visit = Visit(launch(), site / "index.html", wait=False)
    visit.page.locator("iframe.demo").scroll_into_view_if_needed()
    inside = visit.page.frame_locator("iframe.demo")
    inside.locator("html[data-ready]").wait_for(state="attached", timeout=60_000)
    assert inside.locator("#panels canvas").count() == 2
    box = visit.page.locator("iframe.demo").bounding_box()
    assert box["width"] > 500
    assert box["height"] > 500
    assert not visit.errors
    visit.page.close()


def test_no_page_loads_anything_from_elsewhere(pages: dict[Path, Page], site: Path) -> None:
    for path, page in pages.items():
        for load in page.loads:
            found = urlsplit(load)
            if found.scheme == "data":
                continue
            assert not found.scheme + found.netloc, (path.name, load)
            assert (path.parent / unquote(found.path)).is_file(), (path.name, load)
    assert "<math" in (site / "method.html").read_text(encoding="utf-8")


def test_every_public_name_has_its_entry(pages: dict[Path, Page], site: Path) -> None:
    assert len(o3dls.PUBLIC) > 30
    assert not {f"o3dls.{name}" for name in o3dls.PUBLIC} - pages[site / "api.html"].anchors
    text = (site / "api.html").read_text(encoding="utf-8")
    assert "what a step minimises" in text  # a parameter of icp with its meaning


def test_every_command_has_its_entry_with_every_option(pages: dict[Path, Page], site: Path) -> None:
    text = (site / "commands.html").read_text(encoding="utf-8")
    for name, command in cli.commands.items():
        assert f"o3dls-{name}" in pages[site / "commands.html"].anchors
        flags = [one for option in command.params for one in option.opts if one.startswith("--")]
        assert not [one for one in flags if one not in text]


def test_the_search_finds_a_word_without_a_network(site: Path, launch: Callable[..., Any]) -> None:
    visit = Visit(launch(webgl=False), site / "index.html", wait=False)
    visit.page.locator("input.sidebar-search").fill("ostium")
    visit.page.keyboard.press("Enter")
    visit.page.locator("ul.search li a", has_text="Glossary").first.wait_for()
    assert not visit.errors
    assert all(request.startswith("file:") for request in visit.requests)


@pytest.mark.parametrize("word", ["CARTO", "ostium"])
def test_a_result_of_the_search_has_an_excerpt_with_the_word_also_from_a_file(
    site: Path, launch: Callable[..., Any], word: str
) -> None:
    visit = Visit(launch(webgl=False), f"{(site / 'search.html').as_uri()}?q={word}", wait=False)
    marks = visit.page.locator("ul.search li .context mark")
    marks.first.wait_for()
    assert {text.lower() for text in marks.all_inner_texts()} == {word.lower()}
    if word == "CARTO":
        visit.page.locator("ul.search li a", has_text="A CARTO study on its late").first.wait_for()
    assert not visit.errors
    assert violations(visit) == []


@pytest.mark.parametrize("width", [390, 1440])
def test_no_page_is_wider_than_the_window(site: Path, launch: Callable[..., Any], width: int) -> None:
    page = launch(webgl=False).new_page(viewport={"width": width, "height": 900})
    wider = {}
    for path in sorted(site.glob("*.html")):
        page.goto(path.as_uri())
        wide = page.evaluate("document.documentElement.scrollWidth")
        if wide > width:
            wider[path.name] = wide
    assert not wider


@pytest.mark.parametrize(("width", "scheme"), [(1440, "light"), (390, "dark")])
def test_axe_finds_nothing_on_any_page(
    width: int, scheme: str, site: Path, launch: Callable[..., Any]
) -> None:
    browser = launch(webgl=False)
    found = {}
    for path in sorted(site.glob("*.html")):
        visit = Visit(browser, path, width=width, wait=False, color_scheme=scheme)
        if wrong := violations(visit):
            found[path.name] = wrong
        visit.page.close()
    assert not found


def test_the_pages_have_what_axe_asks_for(site: Path) -> None:
    """Without a browser: each change of the HTML finds its place, and a second time changes nothing."""
    changes = runpy.run_path(str(ROOT / "docs" / "site_access.py"))
    pages = [path.read_text(encoding="utf-8") for path in sorted(site.glob("*.html"))]
    assert all(changes["accessible"](page) == page for page in pages)
    for mark in (
        'aria-level="2"',
        'aria-label="Pages"',
        '<pre tabindex="0">',
        'container" tabindex',
        "<h1>Search</h1>",
    ):
        assert any(mark in page for page in pages), mark
