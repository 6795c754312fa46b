"""What follows a run: ICP alone, warnings with what mends them, runs that are compared, and exports that a
kill leaves whole or not there.
"""

from __future__ import annotations

import html
import http.client
import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from threading import Timer

import pytest

from o3dls.app.mends import ANCHORS, BRING, MENDS, list_warnings
from o3dls.io.surfaces import read_surface
from o3dls.pipeline.file import all_mistakes, read_pipeline
from o3dls.resources import demo_case
from o3dls.run_warning import CODES, RunWarning
from o3dls.runs.folder import read_run
from tests.app import visited
from tests.app.hand import says
from tests.app.served import Served, ask_as_page, served
from tests.browser import Visit, violations
from tests.viewer import FIXTURES

_, _, launch, browser, _ = FIXTURES
visit = visited.FIXTURES[1]

RUN = 300.0  # seconds
KILLS = 8


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """An app with a case and two runs of ICP alone."""
    work = tmp_path_factory.mktemp("work")
    shutil.copytree(demo_case(), work / "cases" / "one")
    (work / "cases" / "one" / "case.toml").write_text('name = "one"\n')
    with served(work) as made:
        for out in ("runs/one-icp", "runs/one-icp_2"):
            assert made.act("/fuse", {"case": "cases/one", "preset": "icp"}) == {"run": out}
            end = time.monotonic() + RUN
            while (job := made.desk.job) is None or job.state == "running":
                assert time.monotonic() < end
                time.sleep(0.1)
            assert job.state == "done", job.said
        yield made


def test_icp_alone_is_a_pipeline_file_in_the_case_that_the_command_takes(app: Served) -> None:
    run = read_run(app.folder / "runs" / "one-icp")
    assert list(run.estimates) == ["start", "landmarks", "icp"]
    assert all_mistakes(app.folder / "cases" / "one" / "icp_only.toml") == []
    assert app.desk.job is not None
    assert app.desk.job.record()["command"] == "o3dls run cases/one/icp_only.toml --out runs/one-icp_2"


def test_a_case_says_what_each_run_would_write(app: Served) -> None:
    page = app.ask("GET", "/case?folder=cases/one")[1]
    for out in ("runs/one", "runs/one-quick", "runs/one-icp_3"):
        assert f"Writes <code>{out}</code>" in page
    assert "runs/one-own" not in page  # there is no pipeline.toml
    assert page.count("data-run=") == 2  # its runs


def test_a_run_leads_back_to_its_case_and_to_its_report(app: Served) -> None:
    page = app.ask("GET", "/run?folder=runs/one-icp")[1]
    assert 'href="case?folder=cases/one"' in page
    assert "no data for Expected error: no stage gives a posterior" in page
    text = page.partition('id="pipeline"')[2].partition(">")[2].partition("</pre>")[0]
    again = app.folder.parent / "pipeline.toml"
    again.write_text(html.unescape(text))
    assert read_pipeline(again).record() == read_run(app.folder / "runs" / "one-icp").provenance.pipeline
    status, text, headers = app.ask("GET", "/runs/one-icp/report.html")
    assert (status, "<h1>one</h1>" in text) == (200, True)
    assert headers["content-security-policy"].startswith("sandbox")


@pytest.mark.parametrize("code", CODES)
def test_every_warning_says_what_mends_it_and_leads_there(code: str) -> None:
    words, step = MENDS[code]
    text = str(list_warnings([RunWarning(code, "It is odd.")], "cases/a b"))
    assert "It is odd." in text
    assert f"What mends it: {words.partition(' ')[0]}" in text
    target = re.findall('href="([^"]+)"', text)
    if step in ANCHORS:
        assert target == [f"case?folder=cases/a%20b#{ANCHORS[step]}"]
        assert "href" not in str(list_warnings([RunWarning(code, "It is odd.")], None))
    else:
        assert target == (["./#bring"] if step == BRING else [])


def test_runs_are_compared_and_made_a_cohort_from_the_list(visit: Visit, app: Served) -> None:
    page = visit.page
    page.click("#compare")
    says(visit, "#compared", "Choose two runs or more.")
    page.get_by_label("compare runs/one-icp", exact=True).check()
    page.get_by_label("compare runs/one-icp_2", exact=True).check()
    assert violations(visit) == []
    page.click("#compare")
    says(visit, "h1", "1 case, 2 runs compared")
    links = page.locator("a[href='runs/one-icp/report.html']")
    links.first.wait_for()
    page.goto(f"http://{app.host}/runs/one-icp/report.html")
    says(visit, "h1", "one")
    page.goto(f"http://{app.host}/")
    page.click("#there >> text=all of runs")
    says(visit, "h1", "1 case, 2 runs compared")
    assert sorted(path.name for path in app.folder.iterdir()) == ["cases", "runs"]


def test_each_line_of_the_list_says_what_it_is_beside_a_picture(visit: Visit) -> None:
    for line, said in (("[data-case='cases/one']", "points"), ("[data-run='runs/one-icp']", "CHECK")):
        says(visit, f"{line} .grade", said)
        picture = visit.page.locator(f"{line} img")
        picture.wait_for()
        assert picture.evaluate("one => one.naturalWidth") > 0
    assert violations(visit) == []


def test_one_run_is_not_compared(app: Served) -> None:
    status, text, _ = app.ask("GET", "/compare?run=runs/one-icp")
    assert (status, "choose 2 or more" in text) == (422, True)


def test_an_export_that_is_killed_is_whole_or_not_there(app: Served) -> None:
    """Killed after more and more of its time; the next export works, and leaves nothing half made."""
    folder = app.folder / "runs" / "one-icp" / "export"
    before = time.monotonic()
    assert "file" in app.act("/export", {"run": "runs/one-icp", "export": "vtp"})
    seconds = time.monotonic() - before
    whole = (folder / "icp.vtp").read_bytes()
    refused = 0
    for k in range(KILLS):
        (folder / "icp.vtp").unlink(missing_ok=True)
        process = app.desk._reader._worker._process
        killer = Timer(seconds * (k + 1) / KILLS, process.kill)
        killer.start()
        answer = app.act("/export", {"run": "runs/one-icp", "export": "vtp"})
        killer.join()
        process.join(10.0)
        refused += answer.get("error") == "its process was ended"
        if (folder / "icp.vtp").exists():
            assert (folder / "icp.vtp").read_bytes() == whole
        else:
            assert "error" in answer
    assert refused > 0
    assert "file" in app.act("/export", {"run": "runs/one-icp", "export": "vtp"})
    assert (folder / "icp.vtp").read_bytes() == whole
    assert sorted(path.name for path in folder.iterdir()) == ["icp.vtp", "icp.vtp.json"]
    assert len(read_surface(folder / "icp.vtp").vertices) > 1000
    read_run(app.folder / "runs" / "one-icp")


def test_a_server_that_is_killed_while_it_exports_leaves_the_file_whole_or_not_there(app: Served) -> None:
    folder = app.folder / "runs" / "one-icp_2" / "export"
    assert "file" in app.act("/export", {"run": "runs/one-icp_2", "export": "vtp"})
    whole = (folder / "icp.vtp").read_bytes()
    (folder / "icp.vtp").unlink()
    command = [sys.executable, "-m", "o3dls", "app", str(app.folder), "--no-browser"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        begin_export(process.stderr.readline().strip())
        end = time.monotonic() + 60.0
        while not any(folder.glob("*icp.vtp*")) and time.monotonic() < end:
            time.sleep(0.001)  # until it begins to write
        process.kill()
    written = [path for path in folder.iterdir() if path.name == "icp.vtp"]
    assert all(path.read_bytes() == whole for path in written)
    assert "file" in app.act("/export", {"run": "runs/one-icp_2", "export": "vtp"})
    assert (folder / "icp.vtp").read_bytes() == whole
    read_run(app.folder / "runs" / "one-icp_2")


def begin_export(url: str) -> None:
    """Ask for an export, and wait for no answer."""
    host, headers = ask_as_page(url)
    connection = http.client.HTTPConnection(host, timeout=30)
    connection.request("POST", "/export", json.dumps({"run": "runs/one-icp_2", "export": "vtp"}), headers)
