"""Before and after a print in a real browser: refusals and their remedies, start, what follows."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from playwright.sync_api import expect

from printctl.machine.process.clients.client import Station
from printctl.machine.process.clients.starting import connect
from printctl.machine.process.contact import load_station
from printctl.web.core import Core
from printctl.web.job.service import JobService
from printctl.web.workspace import Workspace
from tests.printctl.checks.preflight.test_shaft_checks import job
from tests.printctl.machine.link.layered import layered
from tests.printctl.web.job.camera.pictures import sequence
from tests.printctl.web.job.conftest import OPERATOR, WORDS, add, ready
from tests.printctl.web.serving import Process, server_process
from tests.printctl.web.shell.browsers import PHONE, WIDE, shown
from tests.sim_process import printer_process
from tests.waiting import wait_for as until

pytestmark = pytest.mark.browser
HOSTILE = b"<script>document.title='owned'</script><img src=x onerror=\"document.title='owned'\">"
MOST_PX = {WIDE["width"]: 1000, PHONE["width"]: 2000}
ASIDE = (90.0, 100.0, 30.0)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Process, Path]]:
    """A printer behind a port, as a machine is, with little ink; a job that crosses a vessel."""
    folder = tmp_path_factory.mktemp("before")
    workspace = Workspace(folder / "workspace").make()
    job(workspace.root / "jobs", 0, 1)
    begin = ",".join(f"{mm:g}" for mm in ASIDE)
    with printer_process(folder, "--start", begin, speed=20.0) as port:
        station = connect("generic_marlin", port, workspace.station)
        station.set_position(*ASIDE)
        station.mount(syringe="hamilton_1ml", ink="collagen_fresh", needle="30g")
        station.mount(plunger_mm=59.9)
        try:
            with server_process(workspace.root) as server:
                yield server, workspace.root
        finally:
            if station.status.open:
                station.kill()
                os.kill(load_station(workspace.station).pid, signal.SIGKILL)


def fits(page: Any) -> None:
    """Compare the page's height with the most it may have, at both sizes."""
    for size in (PHONE, WIDE):
        page.set_viewport_size(size)
        expect(page.get_by_role("button", name="EMERGENCY STOP")).to_be_in_viewport()
        assert page.evaluate("document.documentElement.scrollHeight") <= MOST_PX[size["width"]]
        assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]


def test_refusals_stand_together_are_mended_by_buttons_and_the_print_leads_on(
    served: tuple[Process, Path], browser: Any, tmp_path: Path
) -> None:
    server, root = served
    page = shown(browser, f"{server.url}/job?job=file~part.gcode", viewport=WIDE)
    refusals = page.get_by_role("list", name="What refuses the start").get_by_role("listitem")
    expect(refusals).to_have_count(7)
    for part in ("Bath", "Dish"):
        refusals.get_by_label(part, exact=True).select_option("nothing there")
        expect(refusals.get_by_label(part, exact=True)).to_have_count(0)
    expect(refusals).to_have_count(5)
    expect(page.get_by_text("12 things refuse the start", exact=True)).to_be_visible()
    points = page.get_by_text("Look at the machine: 7 of 7 points left")
    expect(points).to_be_visible()
    start = page.get_by_role("button", name="Start on generic_marlin on ")
    expect(start).to_be_disabled()
    expect(page.get_by_text("12 things refuse the start: mend them in step 3.")).to_be_visible()
    assert page.evaluate("document.documentElement.scrollHeight") <= MOST_PX[WIDE["width"]]

    page.get_by_role("button", name="Move the tip to the start").click()
    page.get_by_role("button", name="A full one was put in").click()
    page.get_by_role("dialog").get_by_role("button", name="Yes, it is full").click()
    refusals.get_by_label("Operator's name").fill("Ada <b>Lovelace</b>")
    page.keyboard.press("Tab")
    page.get_by_label("it was made for what is mounted").check()
    page.get_by_role("button", name="Accept the crossings").click()
    page.get_by_role("dialog").get_by_role("button", name="Accept the crossings").click()
    expect(refusals).to_have_count(0, timeout=60_000)
    for point in range(7):  # what is ticked stays where it is; the others are still open
        page.locator(".job-points").get_by_role("checkbox").nth(point).check()
    expect(page.get_by_text("All 7 points were looked at")).to_be_visible()
    expect(start).to_be_enabled()
    fits(page)

    start.click()
    question = page.get_by_role("dialog", name="Start the print?")
    expect(question).to_contain_text("generic_marlin on ")
    question.get_by_role("button", name="Yes, start it").click()
    expect(page.get_by_role("heading", name="What came out")).to_be_visible(timeout=90_000)
    after_the_end(page, server.url, tmp_path)
    assert (root / "jobs" / "part.gcode.print" / "record.json").is_file()


def after_the_end(page: Any, url: str, tmp_path: Path) -> None:
    """Look at links, tick a step, write a note, add a photo, and set the job up again."""
    expect(page.get_by_role("link", name="Print again").first).to_be_visible()
    history = page.get_by_role("link", name="History", exact=True).last.get_attribute("href")
    identity = history.partition("print=")[2]
    record = page.get_by_role("link", name="Record").get_attribute("href")
    assert record == f"/api/v1/history/{identity}/bundle"
    assert page.request.get(url + record).ok
    fits(page)
    step = page.get_by_role("checkbox", name="Needle parked")
    step.check()
    expect(page.get_by_text("Ada")).to_have_count(0)  # a step is ticked by a browser's name
    expect(step).to_be_checked()
    page.get_by_role("textbox", name="Note").fill("soft <i>gel</i>")
    page.get_by_role("button", name="Add note").click()
    expect(page.get_by_text("soft <i>gel</i>")).to_be_visible()
    picture = tmp_path / "photo.png"
    Image.new("RGB", (64, 32), "red").save(picture)
    page.set_input_files("input[type=file]", str(picture))
    expect(page.get_by_role("img", name="Photo of ")).to_be_visible()
    page.get_by_text("Warm the bath slowly", exact=True).click()
    expect(page.get_by_label("Target")).to_have_value("37")
    page.get_by_role("link", name="Print again").first.click()
    expect(page.get_by_text("Record: Ada <b>Lovelace</b>")).to_be_visible()
    expect(page.get_by_text("Look at the machine: 5 of 7 points left")).to_be_visible()


@pytest.mark.parametrize(("size", "theme"), [(PHONE, "dark"), (WIDE, "light")])
def test_a_job_is_uploaded_set_up_and_never_started_where_it_is_out_of_bounds(
    served: tuple[Process, Path], browser: Any, tmp_path: Path, size: Any, theme: str
) -> None:
    server, _ = served
    file = tmp_path / f"wide_{theme}.gcode"
    file.write_bytes(b";" + HOSTILE + b"\n" + layered(2, 10) + b"G1 X500 Y50 F1800\n")
    page = shown(browser, f"{server.url}/job?other=1", viewport=size, color_scheme=theme)
    page.set_input_files("input[type=file]", str(file))
    page.wait_for_url(f"**/job?job=file~wide_{theme}.gcode")
    expect(page.get_by_text("X, highest: 500 mm, limit 200 mm")).to_be_visible(timeout=60_000)
    expect(page.get_by_role("button", name="Start on ")).to_be_disabled()
    page.get_by_text("Change what is mounted").click()
    page.get_by_label("Bath", exact=True).first.select_option("gelatin_support")
    expect(page.get_by_text("30g, hamilton_1ml, collagen_fresh, gelatin_support")).to_be_visible()
    page.get_by_label("Bath", exact=True).first.select_option("none named")
    expect(page.get_by_text("30g, hamilton_1ml, collagen_fresh", exact=True)).to_be_visible()
    assert page.title() != "owned"


def test_connecting_a_printer_leads_back_to_the_job(browser: Any, tmp_path: Path) -> None:
    workspace = Workspace(tmp_path / "workspace").make()
    (workspace.root / "jobs" / "zigzag.gcode").write_bytes(layered(1, 20))
    with server_process(workspace.root) as server:
        page = shown(browser, f"{server.url}/job?job=file~zigzag.gcode", own=True)
        expect(page.get_by_text("none is connected; connect one, or rehearse")).to_be_visible()
        page.get_by_role("link", name="Connect a printer …").click()
        page.get_by_role("button", name="Connect", exact=True).click()
        page.get_by_role("link", name="Back to zigzag").click(timeout=90_000)
        page.wait_for_url("**/job?job=file~zigzag.gcode")
        expect(page.get_by_role("heading", name="zigzag")).to_be_visible()
        # The legend's colour of what is written is a band of those that are drawn.
        page.wait_for_selector("[data-drawn]")
        band = "getComputedStyle(document.documentElement).getPropertyValue('--live-written')"
        assert page.evaluate(band).startswith("linear-gradient(")
        page.request.post(f"{server.url}/api/v1/printer/disconnect", headers={"Origin": server.url})


def test_a_rehearsal_is_begun_without_a_word(browser: Any, tmp_path: Path) -> None:
    """With no printer: connect a simulated one, move its tip, start."""
    workspace = Workspace(tmp_path / "workspace").make()
    (workspace.root / "jobs" / "zigzag.gcode").write_bytes(layered(1, 20))
    with server_process(workspace.root) as server:
        page = shown(browser, f"{server.url}/job?job=file~zigzag.gcode", own=True)
        page.get_by_role("button", name="Rehearse (simulated)").click()
        page.get_by_role("button", name="Move the tip to the start").click(timeout=60_000)
        start = page.get_by_role("button", name="Start on generic_marlin on simulated")
        expect(start).to_be_enabled(timeout=90_000)
        fits(page)
        start.click()
        page.get_by_role("button", name="Yes, start it").click()
        expect(page.get_by_role("heading", name="What came out")).to_be_visible(timeout=90_000)
        page.get_by_role("link", name="Print again").first.click()
        expect(page.get_by_role("button", name="Move the tip to the start")).to_be_visible()
        page.request.post(f"{server.url}/api/v1/printer/disconnect", headers={"Origin": server.url})


@pytest.mark.slow
def test_the_film_of_a_print_plays_and_is_fetched(
    core: Core, station: Station, browser: Any, tmp_path: Path
) -> None:
    settings = replace(core.settings, camera=sequence(tmp_path / "seen"))
    service = JobService(replace(core, settings=settings))
    try:
        name = add(service)
        until(lambda: service.watching.seen().state == "there")
        service.start(OPERATOR, name, ready(service, name), WORDS)
        until(lambda: service.watching.timelapse(name).film, 60.0)
    finally:
        service.close()
    with server_process(core.workspace.root) as server:  # the film stays, without a camera
        page = shown(browser, f"{server.url}/job?job={name}", viewport=WIDE)
        film = page.get_by_role("img", name="Film of ")
        expect(film).to_be_visible()
        assert film.evaluate("one => one.decode().then(() => one.naturalWidth)") == 320
        with page.expect_download() as downloading:
            page.get_by_role("link", name="Fetch the film").click()
        assert downloading.value.suggested_filename == "zigzag_timelapse.webp"
