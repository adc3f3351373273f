"""Job page in a real browser: upload, check, start, pause, resume, cancel."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from printctl.machine.station import connect
from printctl.web.workspace import Workspace
from tests.printctl.machine.link.layered import layered
from tests.printctl.web.job.conftest import START, shut
from tests.printctl.web.serving import Process, server_process
from tests.printctl.web.shell.browsers import LOOKS, WIDE, serious, shown

pytestmark = pytest.mark.browser
HOSTILE = b"<script>document.title='owned'</script><img src=x onerror=\"document.title='owned'\">"


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Any:
    workspace = tmp_path_factory.mktemp("job") / "workspace"
    station = connect(
        "generic_marlin",
        "simulated",
        Workspace(workspace).make().station,
        sim_speed=4.0,
        start_mm=START,
    )
    station.mount(
        syringe="hamilton_1ml", ink="collagen_fresh", needle="28g", bath="gelatin_support"
    )
    try:
        with server_process(workspace) as server:
            yield server, workspace
    finally:
        shut(station)


def upload(page: Any, path: Path) -> None:
    page.set_input_files("input[type=file] >> nth=0", str(path))
    page.wait_for_url("**/job?job=file~*")
    page.wait_for_selector("text=Set-up and preflight")


def says(page: Any, text: str, timeout: float = 60_000) -> None:
    page.wait_for_selector(f"text={text}", timeout=timeout)


def start(page: Any) -> None:
    """Fill in what a start wants, and start."""
    page.fill('input[aria-label="Operator\'s name"]', "Ada <b>Lovelace</b>")
    page.keyboard.press("Tab")
    says(page, "Written down at")
    for box in page.query_selector_all(".job-point[role=checkbox]")[:7]:
        box.click()
        time.sleep(0.2)
    page.click("button:has-text('Start print')")
    says(page, "generic_marlin on simulated will move now")
    page.click("button:has-text('Yes, start it')")
    says(page, "Printing ·")


@pytest.mark.slow
def test_a_job_is_uploaded_checked_printed_held_and_cancelled_by_clicks(
    served: tuple[Process, Path], browser: Any, tmp_path: Path
) -> None:
    server, workspace = served
    file = tmp_path / "zigzag.gcode"
    file.write_bytes(b";" + HOSTILE + b"\n" + layered(12, 60))
    page = shown(browser, f"{server.url}/job", viewport=WIDE)
    upload(page, file)
    page.click("button:has-text('Check')")
    says(page, "All checks passed")
    start(page)
    page.wait_for_selector("text=/^2 of 12, /", timeout=60_000)
    page.click("button:has-text('Pause after layer')")
    says(page, "Paused ·")
    assert serious(page) == []
    page.screenshot(path=str(workspace.parent / "paused.png"), full_page=True)
    page.get_by_role("button", name="Resume", exact=True).click()
    says(page, "Printing ·")
    page.reload()
    says(page, "Printing ·")
    page.click("button:has-text('Cancel print')")
    page.click("button:has-text('Yes, cancel it')")
    says(page, "Stopped ·")
    assert page.title() != "owned"
    assert (workspace / "jobs" / "zigzag.gcode.print" / "record.json").is_file()
    says(page, "Printer: ready")
    page.reload()
    page.click("button:has-text('Move the tip to the start')")
    says(page, "The tip stands at the start.")
    start(page)  # printed again, with the station's process as before
    page.click("button:has-text('Pause now')")
    says(page, "Paused ·")
    page.click("button:has-text('Cancel print')")
    page.click("button:has-text('Yes, cancel it')")
    says(page, "Stopped ·")


@pytest.mark.slow
def test_a_job_out_of_bounds_is_refused_with_the_reason(
    served: tuple[Process, Path], browser: Any, tmp_path: Path
) -> None:
    server, _ = served
    file = tmp_path / "wide.gcode"
    file.write_bytes(layered(2, 10) + b"G1 X500 Y50 F1800\n")
    page = shown(browser, f"{server.url}/job", viewport=WIDE)
    upload(page, file)
    page.click("button:has-text('Check')")
    says(page, "no start")
    failed = page.locator(".job-failed").all_inner_texts()
    assert any("x, highest: 500 mm, limit 200 mm" in text for text in failed)


@pytest.mark.slow
@pytest.mark.parametrize(("viewport", "theme"), LOOKS)
def test_the_page_is_for_everybody(
    served: tuple[Process, Path], browser: Any, tmp_path: Path, viewport: Any, theme: Any
) -> None:
    server, workspace = served
    file = tmp_path / "small.gcode"
    file.write_bytes(b";" + HOSTILE + b"\n" + layered(2, 10))
    page = shown(browser, f"{server.url}/job", viewport=viewport, color_scheme=theme)
    upload(page, file)
    take = page.locator("#pc-take")
    while take.inner_text() != "Release":  # another's are taken over by a second press
        take.click()
        page.wait_for_timeout(300)
    page.click("button:has-text('Move the tip to the start')")
    says(page, "The tip stands at the start.")
    page.click("button:has-text('Check')")
    says(page, "All checks passed")
    page.wait_for_timeout(500)
    found = serious(page)
    width = viewport["width"]
    page.screenshot(path=str(workspace.parent / f"{theme}_{width}.png"), full_page=True)
    assert found == []
    assert page.title() != "owned"
    assert page.evaluate("document.documentElement.scrollWidth") <= width
