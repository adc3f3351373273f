"""Printer page in Chromium, with server and simulated printer as real processes."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from printctl.machine.link.errors import LinkError
from printctl.machine.station import attach
from tests.printctl.web.serving import server_process
from tests.printctl.web.shell.browsers import LOOKS, serious
from tests.printctl.web.shell.dialogs import serious_in_dialog

pytestmark = pytest.mark.browser
Open = Callable[..., Page]


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    workspace = tmp_path_factory.mktemp("page") / "ws"
    with server_process(workspace, "--sim-speed", "20") as server:
        yield server.url
    with contextlib.suppress(LinkError):  # it outlives its server, as it should
        attach(workspace / "station").close()


@pytest.fixture(scope="module")
def operator(browser: Browser) -> Iterator[BrowserContext]:
    """The one browser that holds the controls."""
    context = browser.new_context()
    yield context
    context.close()


@pytest.fixture(scope="module")
def pages() -> dict[str, Page]:
    """Those that are open: to load one takes seconds of a core, and so does each beside it."""
    return {}


@pytest.fixture
def visit(operator: BrowserContext, url: str, pages: dict[str, Page]) -> Iterator[Open]:
    """Open the page as the operator; the tests share server, printer and page."""
    wrong: list[str] = []

    def note(error: object) -> None:
        wrong.append(str(error))

    def open_page(
        width: int = 1400, height: int = 1000, scheme: str = "light", name: str = "shared"
    ) -> Page:
        known = pages.get(name)
        page = pages[name] = known or operator.new_page()
        page.on("pageerror", note)
        page.set_viewport_size({"width": width, "height": height})
        was_dark = page.evaluate("matchMedia('(prefers-color-scheme: dark)').matches")
        page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
        if known is None:
            page.goto(f"{url.rstrip('/')}/printer")
        elif was_dark != (scheme == "dark"):
            page.reload()  # colours that fade from one theme to the other have too little contrast
        expect(page.get_by_role("heading", name="Connection")).to_be_visible(timeout=30_000)
        return page

    yield open_page
    for page in pages.values():
        with contextlib.suppress(KeyError):  # it isn't of this test
            page.remove_listener("pageerror", note)
    assert wrong == []


def connected(page: Page) -> Page:
    """Connect the simulated printer unless it is."""
    go = page.get_by_role("button", name="Connect", exact=True)
    ready = page.get_by_text("ready: connected, checked")
    expect(go.or_(ready).first).to_be_visible(timeout=30_000)
    if go.is_visible():
        go.click()
    expect(ready).to_be_visible(timeout=90_000)
    expect(page.get_by_role("button", name="X +")).to_be_enabled(timeout=10_000)
    return page


def typed(page: Page, text: str) -> None:
    line = page.get_by_role("textbox", name="Command", exact=True)
    line.fill(text)
    line.press("Enter")


def place(page: Page) -> list[float]:
    """X, Y and Z as the page shows them."""
    pad = page.get_by_role("region", name="Move by hand")
    return [float(text) for text in pad.locator(".text-2xl").all_inner_texts()]


def comes_to(page: Page, axis: int, value: float) -> None:
    pad = page.get_by_role("region", name="Move by hand")
    expect(pad.locator(".text-2xl").nth(axis)).to_have_text(f"{value:.2f}", timeout=20_000)


def chosen(page: Page, label: str, option: str) -> None:
    page.get_by_role("dialog").get_by_label(label, exact=True).click()
    page.get_by_role("option", name=option, exact=True).click()


def test_connect_jog_by_button_and_key_and_see_it_move(visit: Open) -> None:
    page = connected(visit())
    x, y, z = place(page)
    page.get_by_role("button", name="X +").click()
    comes_to(page, 0, x + 1)
    page.get_by_role("button", name="0.1 mm", exact=True).click()
    page.get_by_role("group", name="Jog pad").focus()
    page.keyboard.press("ArrowUp")
    comes_to(page, 1, y + 0.1)
    page.keyboard.press("PageUp")
    comes_to(page, 2, z + 0.1)


def test_a_refused_move_is_explained_beside_the_pad(visit: Open) -> None:
    page = connected(visit())
    page.get_by_role("button", name="10 mm", exact=True).click()
    for _ in range(6):
        page.get_by_role("button", name="X −").click()
        page.wait_for_timeout(400)
    pad = page.get_by_role("region", name="Move by hand")
    expect(pad.get_by_text("is outside 0 to 200 mm")).to_be_visible(timeout=10_000)
    assert place(page)[0] >= 0


def test_console_shows_replies_and_refusals_and_remembers(visit: Open) -> None:
    page = connected(visit())
    typed(page, "M115")
    log = page.get_by_role("log")
    expect(log.get_by_text("FIRMWARE_NAME").last).to_be_visible(timeout=10_000)
    typed(page, "M112")
    expect(log.get_by_text("refused: M112 isn't for manual use").last).to_be_visible(timeout=10_000)
    line = page.get_by_role("textbox", name="Command", exact=True)
    line.press("ArrowUp")
    expect(line).to_have_value("M112")
    line.press("ArrowUp")
    expect(line).to_have_value("M115")


@pytest.mark.slow
def test_another_browser_sees_what_is_typed_as_text_and_moves_nothing(
    visit: Open, browser: Browser, url: str
) -> None:
    page, other = connected(visit()), browser.new_page()
    try:
        other.goto(f"{url.rstrip('/')}/printer")
        typed(page, "M117 <b id=evil>hello</b>")
        for one in (page, other):
            expect(one.get_by_role("log").get_by_text("<b id=evil>").first).to_be_visible(
                timeout=20_000
            )
            assert one.locator("#evil").count() == 0
        before = place(page)
        other.get_by_role("button", name="X +").click()
        expect(other.get_by_text("holds the controls").first).to_be_visible(timeout=10_000)
        assert place(page) == before
    finally:
        other.close()


@pytest.mark.slow
def test_a_macro_is_written_run_and_seen_in_the_console(visit: Open) -> None:
    page = connected(visit())
    page.get_by_role("button", name="New macro").click()
    page.get_by_label("Name", exact=True).fill("Where")
    page.get_by_label("Commands, one a line").fill("M114\nM105")
    page.get_by_role("button", name="Save").click()
    page.get_by_role("button", name="Where", exact=True).click()
    expect(page.get_by_role("log").get_by_text("Count X").last).to_be_visible(timeout=10_000)
    page.get_by_role("button", name="Edit Where").click()
    page.get_by_label("Commands, one a line").fill("M112")
    page.get_by_role("button", name="Save").click()
    expect(page.get_by_text("line 1: M112 isn't for manual use")).to_be_visible(timeout=10_000)


def test_needle_is_touched_off_by_three_readings(visit: Open) -> None:
    page = connected(visit())
    page.get_by_role("button", name="Say what is mounted").click()
    for label, option in (("Needle", "25g"), ("Dish", "petri_60mm"), ("Ink", "collagen_fresh")):
        chosen(page, label, option)
    page.get_by_role("button", name="That is mounted").click()
    card = page.get_by_role("region", name="Needle offset and bath level")
    expect(card.get_by_text("to be touched off before the next print")).to_be_visible(
        timeout=10_000
    )
    card.get_by_role("button", name="Touch off the floor").click()
    use = card.get_by_role("button", name="Use this height")
    expect(use).to_be_disabled(timeout=10_000)
    for count in (1, 2, 3):
        card.get_by_role("button", name="Touched: take this reading").click()
        expect(card.get_by_text(f"{count} of {3 if count < 3 else count} readings")).to_be_visible(
            timeout=10_000
        )
    expect(use).to_be_enabled(timeout=10_000)
    use.click()
    expect(card.get_by_text("Needle 25g: floor Z")).to_be_visible(timeout=10_000)
    expect(page.get_by_text("dish's floor Z")).to_be_visible(timeout=10_000)


def test_wizard_of_a_syringe_sets_zero_and_purges(visit: Open) -> None:
    page = connected(visit())
    page.get_by_role("button", name="Change the syringe").click()
    page.get_by_role("button", name="It is up: next").click()
    page.get_by_label("Filled with").fill("600")
    page.get_by_role("button", name="It is in, the plunger touched: zero").click()
    page.get_by_role("button", name="Push 1 µL").click()
    expect(page.get_by_text("1 µL pushed out")).to_be_visible(timeout=20_000)
    page.get_by_role("button", name="It comes clean: next").click()
    done = page.get_by_role("button", name="Done", exact=True)
    expect(done).to_be_disabled()
    page.get_by_role("checkbox", name="Wiped").click()
    done.click()
    expect(page.get_by_text("µL left")).to_be_visible()


@pytest.mark.slow
def test_wizard_of_weighing_makes_a_job_and_reads_the_balance(visit: Open) -> None:
    page = connected(visit(name="weighing"))  # the dialogs before it have scrolled the other
    page.get_by_role("button", name="Start: Flow by weight").click()
    page.get_by_role("button", name="Make the test's G-code").click()
    expect(page.get_by_text("file~calibrate_weigh_")).to_be_visible(timeout=20_000)
    for row in range(1, 13):
        travel = page.get_by_label(f"travel_mm, row {row}", exact=True).input_value()
        page.get_by_label(f"mass_mg, row {row}", exact=True).fill(f"{float(travel) * 17:.2f}")
    page.get_by_role("button", name="What do they say?").click()
    expect(page.get_by_text("volume per travel")).to_be_visible(timeout=10_000)
    page.get_by_label("Name of the copy").fill("weighed_here")
    page.get_by_role("button", name="Write the copy").click()
    expect(page.get_by_text("written: steps_per_mm.e")).to_be_visible(timeout=10_000)


@pytest.mark.parametrize(("size", "scheme"), LOOKS)
def test_page_is_accessible_and_fits(visit: Open, size: dict[str, int], scheme: str) -> None:
    page = connected(visit(size["width"], size["height"], scheme))
    page.wait_for_timeout(500)
    assert serious(page) == []
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    small = page.evaluate(
        """() => [...document.querySelectorAll('.pc-content button, .pc-content [role=button]')]
        .filter(b => b.offsetParent).map(b => [b.innerText, b.getBoundingClientRect()])
        .filter(([, r]) => r.height < 44 || r.width < 44).map(([t]) => t)"""
    )
    assert small == []
    assert page.get_by_role("heading", level=1).count() == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "openers",
    [("Say what is mounted", "Home", "New macro"), ("Change the syringe",), ("Start: Level",)],
)
def test_dialogs_are_accessible(visit: Open, openers: tuple[str, ...]) -> None:
    page = connected(visit(820, 1180, name="dialogs"))
    for opener in openers:
        page.get_by_role("button", name=opener).first.click()
        assert serious_in_dialog(page) == []
        page.keyboard.press("Escape")
        page.wait_for_timeout(500)


@pytest.mark.slow
def test_page_of_a_new_server_finds_the_printer_again(browser: Browser, tmp_path: Path) -> None:
    workspace = tmp_path / "ws"
    page = browser.new_page()
    try:
        with server_process(workspace, "--sim-speed", "20") as server:
            page.goto(f"{server.url.rstrip('/')}/printer")
            connected(page)
        with server_process(workspace, "--sim-speed", "20") as server:
            page.goto(f"{server.url.rstrip('/')}/printer")
            connected(page)
            expect(page.get_by_role("button", name="Disconnect")).to_be_visible()
            page.get_by_role("button", name="Disconnect").click()
            expect(page.get_by_role("button", name="Connect", exact=True)).to_be_visible(
                timeout=30_000
            )
    finally:
        page.close()
