"""Set up a printer by REST and by the page, with the steps and the file of the command line."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from firmware_profiles import Printer, load
from printctl.commissioning.state import Commission
from printctl.errors import UsageError
from printctl.machine.errors import LinkError
from printctl.machine.process.clients.client import attach_station
from printctl.web.commissioning import Commissioning, GoOn
from printctl.web.controls import Principal
from printctl.web.core import Core
from printctl.web.errors import BadRequestError, ConflictError, NotInControlError
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace
from tests.printctl.web.serving import server_process
from tests.printctl.web.shell.browsers import WIDE


@pytest.fixture
def page(tmp_path: Path, browser: Browser, monkeypatch: pytest.MonkeyPatch) -> Iterator[Page]:
    """The page of a new workspace, where the printer's choice is shown."""
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    workspace = tmp_path / "ws"
    with server_process(workspace) as server:
        context = browser.new_context(viewport=WIDE)  # type: ignore[arg-type]
        page, wrong = context.new_page(), []
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.goto(f"{server.url.rstrip('/')}/printer")
        yield page
        context.close()
        assert wrong == []
    with contextlib.suppress(LinkError):
        attach_station(workspace / "station").close()


def answered(page: Page, question: str, value: str = "") -> None:
    """Answer the question that is asked next; its default stays without a value."""
    field = page.get_by_label(question)
    expect(field).to_be_visible(timeout=120_000)
    if value and field.evaluate("one => one.tagName") == "SELECT":
        field.select_option(value)
    elif value:
        field.fill(value)
    page.get_by_role("button", name="Next", exact=True).click()


def confirmed(page: Page, question: str) -> None:
    expect(page.get_by_text(question)).to_be_visible(timeout=120_000)
    page.get_by_role("button", name="Yes, do it").click()


@pytest.mark.browser
def test_a_new_user_gets_from_the_choice_of_printer_to_the_weighed_steps(
    page: Page, tmp_path: Path
) -> None:
    page.get_by_role("link", name="Set up a printer").click()
    expect(page.get_by_role("heading", name="Set up a printer", level=1)).to_be_visible()
    page.get_by_label("Name of the printer").fill("lab_a")
    page.get_by_role("button", name="Begin").click()
    page.get_by_role("button", name="Go on", exact=True).click()
    answered(page, "Port: a device", "simulated")
    answered(page, "Which shipped profile", "generic_marlin")
    answered(page, "Which syringe is mounted", "hamilton_1ml")
    confirmed(page, "Push 10 µL?")
    answered(page, "Which way did the plunger move", "backward")
    expect(page.get_by_text("so E has the wrong sign").first).to_be_visible(timeout=60_000)
    page.reload()  # it goes on where it stopped
    page.get_by_role("button", name="Try again").click()
    confirmed(page, "Push 10 µL?")
    answered(page, "Which way did the plunger move")
    answered(page, "Seconds to change a vial")
    confirmed(page, "Push 12 doses")
    answered(page, "Masses of the 12 doses", ",".join(["21", "42", "63"] * 4))
    confirmed(page, "Send M92 E6")
    answered(page, "Which syringe: bd_10ml", "hamilton_1ml")
    expect(page.get_by_label("Which needle")).to_be_visible()
    steps = page.get_by_role("list").filter(has_text="Plunger steps").get_by_role("listitem")
    expect(steps.nth(2)).to_contain_text("6400.00 to 60")
    file = tmp_path / "ws" / "profiles" / "printers" / "lab_a.yaml"
    assert load(Printer, str(file)).steps_per_mm.e < 6200
    kept: dict[str, Any] = Commission.load(str(file)).step("steps").facts
    assert kept["written"] is True


def test_another_browser_s_controls_and_a_shipped_name_start_nothing(tmp_path: Path) -> None:
    core = Core(ServeSettings(tmp_path), Workspace(tmp_path).make())
    service, me = Commissioning(core), Principal("me")
    core.controls.take(me)
    with pytest.raises(NotInControlError):
        service.go_on("lab_a", GoOn(), Principal("other"))
    with pytest.raises(ConflictError, match="shipped profile's name"):
        service.state("generic_marlin")
    with pytest.raises(UsageError, match="no step 'colour'"):
        service.go_on("lab_a", GoOn(begin="colour"), me)
    for answers in ({"scan": "/etc/hostname"}, {"widths": "../../hosts"}, {"ink": "/etc/x.yaml"}):
        with pytest.raises(BadRequestError, match="outside the workspace"):
            service.go_on("lab_a", GoOn(answers=answers), me)
    assert service.printers() == []
    assert service.state("lab_a")["next"] == "profile"
