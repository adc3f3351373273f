"""Job page beside a print: all on one screen, prints told apart, stop, recovery."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from printctl.machine.process.clients.starting import connect
from printctl.machine.process.contact import load_station
from printctl.web.core import Core
from printctl.web.job.service import JobService
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace
from tests.printctl.web.job.conftest import MOUNTED, OPERATOR, START, add, ready
from tests.printctl.web.serving import Process, server_process
from tests.printctl.web.shell.browsers import serious, shown, take_controls
from tests.sim_process import printer_process
from tests.waiting import wait_for

pytestmark = pytest.mark.browser
LOOKS = [(1024, 768, "dark"), (1280, 800, "dark"), (1024, 768, "light"), (400, 800, "light")]
TILES = ("Time left", "Layer", "Ink", "Temperatures", "Tip", "Alarms")
NAME = "a_part_with_a_rather_long_name_as_people_give.gcode"


@dataclass(frozen=True)
class UnderWay:
    server: Process
    workspace: Workspace
    service: JobService
    words: str
    job: str

    def begin(self) -> str:
        """Start the job (again); return the print's identity."""
        wait_for(lambda: (one := self.service.printing.machine()) is not None and one.ready, 60)
        self.service.to_start(OPERATOR, self.job, START)
        set_up = ready(self.service, self.job).model_copy(update={"dish": "none"})
        report = self.service.start(OPERATOR, self.job, set_up, self.words)
        return report.journal.print_id


@pytest.fixture(scope="module")
def under_way(tmp_path_factory: pytest.TempPathFactory) -> Iterator[UnderWay]:
    folder = tmp_path_factory.mktemp("first")
    start = ",".join(f"{mm:g}" for mm in START)
    with printer_process(folder, "--start", start, speed=2) as port:
        workspace = Workspace(folder / "workspace").make()
        station = connect("generic_marlin", port, workspace.station)
        station.set_position(*START)
        station.mount(**MOUNTED)
        service = JobService(Core(ServeSettings(workspace.root), workspace))
        with server_process(workspace.root) as server:
            job = add(service, NAME, 20, 200)
            under = UnderWay(server, workspace, service, f"generic_marlin on {port}", job)
            under.begin()
            try:
                yield under
            finally:
                service.close()
                if station.status.open:
                    station.kill()
                    os.kill(load_station(workspace.station).pid, signal.SIGKILL)


def boxes(page: Any) -> dict[str, dict[str, float]]:
    """Bounding boxes of the twelve things that must be seen, by name."""
    tiles = page.get_by_role("region", name="Print").locator("dl > div")
    found = {name: tiles.filter(has=page.get_by_text(name, exact=True)).first for name in TILES} | {
        "EMERGENCY STOP": page.locator("#pc-stop"),
        "pause": page.get_by_role("button", name="Pause now"),
        "cancel": page.get_by_role("button", name="Cancel print"),
        "state": page.get_by_role("heading", name="Printing ·"),
        "progress": page.get_by_role("progressbar", name="Share of the print made"),
        "live view": page.get_by_role("application", name=re.compile("^Picture of the print")),
    }
    assert len(found) == 12
    return {name: one.bounding_box() for name, one in found.items()}


def shown_under_way(browser: Any, under_way: UnderWay) -> Any:
    page = shown(browser, f"{under_way.server.url}/job")
    page.get_by_role("heading", name="Printing ·").wait_for()
    page.get_by_text(" of 20").first.wait_for()
    page.wait_for_selector("[data-drawn]")
    return page


def assert_all_must_be_seen(page: Any, width: int, height: int, theme: Any) -> None:
    page.set_viewport_size({"width": width, "height": height})
    page.emulate_media(color_scheme=theme)
    page.wait_for_timeout(300)
    narrow = width < 760  # there the pages' names are a bar at the bottom
    bottom = height - (page.get_by_role("navigation").bounding_box()["height"] if narrow else 0)
    for name, box in boxes(page).items():
        assert box["y"] >= 0, name
        assert box["y"] + box["height"] <= bottom, name
        assert box["x"] >= 0, name
        assert box["x"] + box["width"] <= width, name
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate("document.documentElement.scrollHeight") <= height
    assert serious(page) == []


@pytest.mark.slow
@pytest.mark.parametrize(("width", "height", "theme"), LOOKS)
def test_all_that_must_be_seen_stands_on_the_first_screen_of_each_size(
    under_way: UnderWay, browser: Any, width: int, height: int, theme: Any
) -> None:
    assert_all_must_be_seen(shown_under_way(browser, under_way), width, height, theme)


def heading(page: Any, state: str) -> None:
    page.get_by_role("heading", name=f"{state} ·").wait_for(timeout=60_000)


def test_one_screen_then_cancelled_printed_again_broken_off_gone_on_with_and_stopped(
    under_way: UnderWay, browser: Any
) -> None:
    """One page for all of it: a page beside a print costs seconds of a core."""
    asked: list[str] = []
    page = browser.contexts[0].new_page()
    page.on("request", lambda request: asked.append(request.url))
    page.goto(f"{under_way.server.url}/job")
    heading(page, "Printing")
    page.wait_for_selector("[data-drawn]")
    answers = [one for one in asked if "/static/page/" not in one]
    assert sorted(set(answers)) == sorted(answers), "something was asked for twice"
    assert any("/live/static/gl_painter.js" in one for one in asked)
    assert_all_must_be_seen(page, 1280, 800, "light")
    assert_all_must_be_seen(page, 400, 800, "dark")
    cancelled_and_printed_again(page, under_way)
    broken_off_and_gone_on_with(page, under_way)
    stopped(page, under_way)


def cancelled_and_printed_again(page: Any, under_way: UnderWay) -> None:
    """Both prints are of one process: they are told apart by their own identity."""
    page.get_by_role("button", name="Cancel print").click()
    page.get_by_role("button", name="Yes, cancel it").click()
    heading(page, "Cancelled")
    page.get_by_text("The print was cancelled.").wait_for()
    assert page.get_by_role("button", name="Pause now").count() == 0
    under_way.begin()
    heading(page, "Printing")
    assert page.get_by_text("The print was cancelled.").count() == 0
    for name in ("Pause now", "Cancel print", "Change syringe"):
        page.get_by_role("button", name=name).wait_for()
    take_controls(page)
    page.get_by_role("button", name="Pause now").click()
    heading(page, "Paused")
    assert serious(page) == []
    page.reload()
    heading(page, "Paused")
    page.get_by_role("button", name="Resume", exact=True).click()
    heading(page, "Printing")


def broken_off_and_gone_on_with(page: Any, under_way: UnderWay) -> None:
    """Two clicks after the station was killed."""
    os.kill(load_station(under_way.workspace.station).pid, signal.SIGKILL)
    heading(page, "Interrupted")
    name = f"{NAME[:23]}…"
    assert page.locator("#pc-print").inner_text().startswith("Print: interrupted")
    assert page.title() == f"{name} interrupted · Job · printctl"
    button = page.get_by_role("button", name="Go on …")
    box = button.bounding_box()
    assert box["y"] + box["height"] <= 800
    assert serious(page) == []
    button.click()
    page.get_by_role("button", name="Yes, go on").click()
    heading(page, "Printing")


def stopped(page: Any, under_way: UnderWay) -> None:
    """What happened, what it means and what to do stand there once; codes are one click away."""
    page.locator("#pc-stop").click()
    heading(page, "Halted")
    banner = page.locator("#pc-stopped")
    wait_for(lambda: "The printer has halted:" in banner.inner_text())
    text = page.locator("body").inner_text()
    assert len(re.findall("The printer has halted after an emergency stop", text)) == 1
    assert not re.search(r"M112|M410|left the host", text)
    assert "X" not in page.get_by_role("region", name="How it ended").inner_text()
    page.get_by_text("Details").click()
    page.get_by_text("M112 left the host").wait_for()
    assert serious(page) == []
