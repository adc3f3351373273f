"""First screen of the Job page: all important facts, and recovery choices."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from printctl.machine.station import connect
from printctl.machine.station.record import load_station
from printctl.web.core import Core
from printctl.web.job.service import JobService
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace
from tests.printctl.web.job.conftest import OPERATOR, START, add, ready
from tests.printctl.web.serving import Process, server_process
from tests.printctl.web.shell.browsers import serious, shown
from tests.sim_process import printer_process

pytestmark = pytest.mark.browser
LOOKS = [(1024, 768, "dark"), (1280, 800, "dark"), (1024, 768, "light"), (400, 800, "light")]
MUST = ("time", "layer", "ink", "heat", "tip", "alarms")


@dataclass(frozen=True)
class UnderWay:
    server: Process
    workspace: Workspace
    job: str


@pytest.fixture(scope="module")
def under_way(tmp_path_factory: pytest.TempPathFactory) -> Iterator[UnderWay]:
    folder = tmp_path_factory.mktemp("first")
    start = ",".join(f"{mm:g}" for mm in START)
    with printer_process(folder, "--start", start, speed=0.5) as port:
        workspace = Workspace(folder / "workspace").make()
        station = connect("generic_marlin", port, workspace.station)
        station.set_position(*START)
        station.mount(
            syringe="hamilton_1ml", ink="collagen_fresh", needle="28g", bath="gelatin_support"
        )
        service = JobService(Core(ServeSettings(workspace.root), workspace))
        with server_process(workspace.root) as server:
            job = add(service, "a_part_with_a_rather_long_name_as_people_give.gcode", 20, 200)
            service.start(OPERATOR, job, ready(service, job), f"generic_marlin on {port}")
            try:
                yield UnderWay(server, workspace, job)
            finally:
                service.close()
                if station.status.open:
                    station.kill()
                    os.kill(load_station(workspace.station).pid, signal.SIGKILL)


def boxes(page: Any) -> dict[str, dict[str, float]]:
    """Bounding boxes of what must be seen, by name."""
    found = {"stop": page.locator("#pc-stop"), "pause": page.get_by_text("Pause now")}
    found["state"] = page.locator(".job-print .text-xl")
    for key, tile in zip(MUST, page.locator(".job-fact").all(), strict=True):
        found[key] = tile
    return {name: one.bounding_box() for name, one in found.items()}


def shown_under_way(browser: Any, under_way: UnderWay) -> Any:
    page = shown(browser, f"{under_way.server.url}/job?job={under_way.job}")
    page.wait_for_selector("text=Printing ·")
    page.wait_for_selector("text=/of 20, /")
    return page


def assert_all_must_be_seen(page: Any, width: int, height: int, theme: Any) -> None:
    page.set_viewport_size({"width": width, "height": height})
    page.emulate_media(color_scheme=theme)
    page.wait_for_timeout(300)
    bottom = height - (page.locator(".pc-nav").bounding_box()["height"] if width < 760 else 0)
    for name, box in boxes(page).items():
        assert box["y"] >= 0, name
        assert box["y"] + box["height"] <= bottom, name
        assert box["x"] >= 0, name
        assert box["x"] + box["width"] <= width, name
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert serious(page) == []


@pytest.mark.slow
@pytest.mark.parametrize(("width", "height", "theme"), LOOKS)
def test_all_that_must_be_seen_stands_on_the_first_screen_of_each_size(
    under_way: UnderWay, browser: Any, width: int, height: int, theme: Any
) -> None:
    assert_all_must_be_seen(shown_under_way(browser, under_way), width, height, theme)


def test_all_must_be_seen_and_a_print_whose_station_was_killed_is_gone_on_with_by_two_clicks(
    under_way: UnderWay, browser: Any
) -> None:
    """One page for all of it: a page beside a print costs seconds of a core."""
    page = shown_under_way(browser, under_way)
    assert_all_must_be_seen(page, 1280, 800, "light")
    assert_all_must_be_seen(page, 400, 800, "dark")
    os.kill(load_station(under_way.workspace.station).pid, signal.SIGKILL)
    page.wait_for_selector("text=Interrupted ·")
    state = page.locator(".job-print .text-xl").inner_text()
    header = page.locator("#pc-print").inner_text()
    name = f"{under_way.job.partition('~')[2][:23]}…"  # a long one
    assert header == f"Print: {name}, interrupted, {state.partition('· ')[2]}"
    assert page.title() == f"{name} interrupted · Job · printctl"
    button = page.get_by_role("button", name="Go on …")
    box = button.bounding_box()
    assert box["y"] + box["height"] <= 800
    assert serious(page) == []
    take = page.locator("#pc-take")
    while take.inner_text() != "Release":
        take.click()
        page.wait_for_timeout(300)
    button.click()
    page.click("button:has-text('Yes, go on')")
    page.wait_for_selector("text=Printing ·")
    page.click("button:has-text('Cancel print')")
    page.click("button:has-text('Yes, cancel it')")
    page.wait_for_selector("text=Stopped ·")
