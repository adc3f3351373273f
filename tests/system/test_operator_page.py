"""Web interface end to end by clicks: from a new recipe to the report, and another scan of it."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from design.network_files.csv_format import write_network_csv
from printctl.machine.process.clients.client import attach_station
from tests.printctl.web.serving import Process, server_process
from tests.printctl.web.shell.browsers import PHONE, serious, shown, until
from tests.system.forks import FORK, of_fork

pytestmark = pytest.mark.browser
_LONG_MS = 600_000


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("operator") / "workspace"
    (folder / "recipes").mkdir(parents=True)
    write_network_csv(folder / "recipes" / "fork.csv", FORK)
    yield folder
    attach_station(folder / "station").close()


def _serve(workspace: Path, *more: str) -> Any:
    return server_process(workspace, "--sim-speed", "15", *more)


@pytest.mark.slow
def test_from_a_recipe_to_its_report_by_clicks_alone(workspace: Path, browser: Any) -> None:
    with _serve(workspace) as server:
        port = server.url.rsplit(":", 1)[1].strip("/")
        page = shown(browser, f"{server.url}/scan")
        page.get_by_role("heading", name="Scan the part, then drop the scan here").wait_for()
        page.goto(f"{server.url}/design")
        _design(page)
        _connect(page, server)
        _begin(page, server)
        _pause_and_go_on(page, workspace)
        _seen_by_another(browser, server)
        server.process.send_signal(signal.SIGKILL)
        server.process.wait()
    page.get_by_text(re.compile("connection to the server", re.I)).first.wait_for()
    with _serve(workspace, "--port", port) as server:
        page = shown(browser, f"{server.url}/job?job=run~one")
        page.get_by_text(re.compile("^(Printing|Done) ·")).wait_for()
        page.get_by_text(re.compile("^Done ·")).wait_for(timeout=_LONG_MS)
        _scan(page, server)
    assert (workspace / "runs" / "one" / "report.html").is_file()


def _design(page: Any) -> None:
    page.get_by_role("button", name="New", exact=True).click()
    page.get_by_label("Name", exact=True).fill("one")
    page.get_by_role("button", name="Make", exact=True).click()
    page.get_by_text("ready to be made").wait_for()
    page.get_by_role("tab", name="Text").click()
    text = page.get_by_label("Recipe as YAML")
    text.fill(of_fork(text.input_value()))
    page.get_by_text("saved", exact=True).wait_for()
    page.get_by_role("tab", name="Make").click()
    page.get_by_role("button", name="Make the design").click()
    page.get_by_text("Made as far as lumens").wait_for(timeout=_LONG_MS)


def _connect(page: Any, server: Process) -> None:
    page.goto(f"{server.url}/printer")
    page.get_by_role("button", name="Connect", exact=True).click()
    page.get_by_text("ready: connected, checked").wait_for(timeout=_LONG_MS)


def _begin(page: Any, server: Process) -> None:
    page.goto(f"{server.url}/job?job=run~one")
    page.get_by_role("button", name="Move the tip to the start").click()
    page.get_by_text("nothing refuses the start", exact=True).wait_for(timeout=_LONG_MS)
    page.get_by_role("button", name="Start on ").click()
    page.get_by_role("button", name="Yes, start it").click()
    page.get_by_text(re.compile("^Printing ·")).wait_for(timeout=_LONG_MS)


def _pause_and_go_on(page: Any, workspace: Path) -> None:
    """Held on the page, looked at from the command line, gone on with after a reload."""
    page.get_by_role("button", name="Pause now").click()
    page.get_by_text(re.compile("^Paused ·")).wait_for(timeout=60_000)
    command = [sys.executable, "-m", "printctl", "status", str(workspace / "runs" / "one")]
    said = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert "paused" in said.stdout
    page.reload()
    page.get_by_text(re.compile("^Paused ·")).wait_for()
    page.get_by_role("button", name="Resume", exact=True).click()
    page.get_by_text(re.compile("^Printing ·")).wait_for(timeout=60_000)


def _seen_by_another(browser: Any, server: Process) -> None:
    """Another browser, as narrow as a phone, sees the same print and doesn't hold the controls."""
    other = shown(browser, f"{server.url}/job?job=run~one", viewport=PHONE, own=True)
    other.get_by_text(re.compile("^Printing ·")).wait_for()
    assert other.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    other.get_by_role("button", name="Pause now").click()
    other.get_by_text(re.compile("holds the controls")).first.wait_for()
    other.get_by_text(re.compile("^Printing ·")).wait_for()
    other.context.close()


def _scan(page: Any, server: Process) -> None:
    page.goto(f"{server.url}/scan?run=one")
    page.get_by_role("button", name="Simulate the scan of one, and judge it").click()
    page.get_by_text("Shifted by x, y, z").wait_for(timeout=_LONG_MS)
    _report(page)


def _report(page: Any) -> None:
    page.get_by_role("link", name="Show the report").click()
    frame = page.get_by_title("Report of ")
    viewer = frame.content_frame.locator("#viewer")
    viewer.scroll_into_view_if_needed()
    frame.content_frame.locator("#viewer[data-state=ready]").wait_for(timeout=60_000)


@pytest.mark.slow
def test_a_scan_is_added_seen_and_registered(workspace: Path, browser: Any, tmp_path: Path) -> None:
    """The run's own scan under another name, as one of another machine would come."""
    scan = shutil.copy(workspace / "runs" / "one" / "scan.tif", tmp_path / "fresh scan.tif")
    with _serve(workspace) as server:
        page = shown(browser, f"{server.url}/scan")
        _add_and_look(page, scan)
        _register(page)
        small = shown(browser, f"{server.url}/scan", viewport=PHONE, color_scheme="dark")
        small.get_by_role("tab", name="Result").wait_for(timeout=60_000)
        assert small.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
        assert serious(small) == []


def _add_and_look(page: Any, scan: Path) -> None:
    page.get_by_label("Add a scan").set_input_files(str(scan))
    page.get_by_role("heading", name="fresh_scan.tif").wait_for(timeout=60_000)
    image = page.get_by_role("img", name="From above (along z)")
    image.wait_for(timeout=60_000)
    until(page, "[...document.images].every((one) => one.naturalWidth > 10)")
    first = image.get_attribute("src")
    page.get_by_label("From above (along z)").and_(page.get_by_role("slider")).press("ArrowRight")
    until(page, f"document.querySelector('figure img').getAttribute('src') !== {first!r}")
    page.get_by_text("Contrast and threshold").click()
    page.get_by_label("Tint what is brighter than").check()
    until(page, "document.querySelector('figure img').getAttribute('src').includes('threshold')")
    assert serious(page) == []


def _register(page: Any) -> None:
    page.get_by_role("button", name="Register", exact=True).click()
    page.get_by_text("Shifted by x, y, z").wait_for(timeout=_LONG_MS)
    page.get_by_role("tab", name="Vessels").click()
    assert page.locator("tbody tr").count() >= 3
    assert serious(page) == []
    page.get_by_role("tab", name="Result").click()
    _report(page)
    assert serious(page) == []
