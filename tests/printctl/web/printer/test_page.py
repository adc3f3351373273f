"""Printer page in Chromium, with server and simulated printer as real processes."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Locator, Page, expect

from printctl.machine.errors import LinkError
from printctl.machine.job.retreat import Retreat
from printctl.machine.process.clients.client import attach_station
from printctl.machine.process.orders import Order
from tests.printctl.web.serving import Process, server_process
from tests.printctl.web.shell.browsers import WIDE

pytestmark = pytest.mark.browser
Open = Callable[..., Page]
TABS = ("Heat and ink", "Touch off", "Console", "Calibration")


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("page") / "ws"


@pytest.fixture(scope="module")
def server(workspace: Path) -> Iterator[Process]:
    with server_process(workspace, "--sim-speed", "20") as server:
        yield server
    with contextlib.suppress(LinkError):  # it outlives its server, as it should
        attach_station(workspace / "station").close()


@pytest.fixture(scope="module")
def operator(browser: Browser, server: Process) -> Iterator[Page]:
    """The one browser that holds the controls; the tests share server, printer and page."""
    context: BrowserContext = browser.new_context()
    yield context.new_page()
    context.close()


@pytest.fixture
def visit(operator: Page, server: Process) -> Iterator[Open]:
    """Open the page as the operator; what goes wrong in a script fails the test."""
    wrong: list[str] = []

    def note(error: object) -> None:
        wrong.append(str(error))

    def open_page(size: dict[str, int] = WIDE, scheme: str = "light", address: str = "") -> Page:
        operator.on("pageerror", note)
        operator.set_viewport_size(size)  # type: ignore[arg-type]
        operator.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
        operator.goto(f"{server.url.rstrip('/')}/printer{address}")
        expect(operator.get_by_role("heading", name="Printer", level=1)).to_be_visible()
        return operator

    yield open_page
    with contextlib.suppress(KeyError):  # it was never opened
        operator.remove_listener("pageerror", note)
    assert wrong == []


def connected(page: Page) -> Page:
    """Connect the simulated printer unless it is."""
    go = page.get_by_role("button", name="Connect", exact=True)
    ready = page.get_by_text("ready: connected, checked")
    expect(go.or_(ready).first).to_be_visible(timeout=30_000)
    if go.is_visible():
        go.click()
    expect(ready).to_be_visible(timeout=90_000)
    return page


def tab(page: Page, name: str) -> Page:
    page.get_by_role("tab", name=name).click()
    return page


def card(page: Page, name: str) -> Locator:
    return page.get_by_role("region", name=name, exact=True)


def typed(page: Page, text: str) -> None:
    line = page.get_by_role("textbox", name="Command", exact=True)
    line.fill(text)
    # Replies come by another channel than the end of the command before.
    expect(page.get_by_role("button", name="Send", exact=True)).to_be_enabled()
    line.press("Enter")


def place(page: Page) -> list[float]:
    """X, Y and Z as the page shows them."""
    texts = card(page, "Move by hand").get_by_role("definition").all_inner_texts()[:3]
    return [float(text.replace("\u2212", "-")) for text in texts]


def comes_to(page: Page, axis: int, value: float) -> None:
    shown = card(page, "Move by hand").get_by_role("definition").nth(axis)
    expect(shown).to_have_text(f"{value:.2f}", timeout=20_000)


def chosen(page: Page, label: str, name: str) -> None:
    page.get_by_role("dialog").get_by_label(label, exact=True).select_option(name)


def test_without_a_printer_only_the_connection_is_offered(visit: Open) -> None:
    page = visit()
    expect(page.get_by_role("heading", name="First connect a printer")).to_be_visible()
    expect(page.get_by_role("radio", name="Simulated printer")).to_be_checked()
    main = page.get_by_role("main")
    expect(main.get_by_role("button")).to_have_text(["Connect"])
    expect(main.get_by_role("tab")).to_have_count(0)
    page.get_by_role("radio", name="A printer at this computer").click()
    expect(page.get_by_label("Port", exact=True)).to_be_visible()
    expect(page.get_by_role("button", name="Look again")).to_be_enabled()
    page.get_by_role("radio", name="Simulated printer").click()


def test_connect_jog_by_button_and_key_and_see_it_move(visit: Open) -> None:
    page = connected(visit())
    x, y, z = place(page)
    page.get_by_role("button", name="X +").click()  # as a second click on Connect would: ignored
    page.wait_for_timeout(800)
    page.get_by_role("button", name="X +").click()
    comes_to(page, 0, x + 1)
    page.get_by_role("radio", name="0.1 mm", exact=True).click()
    page.get_by_role("group", name="Jog pad").focus()
    page.keyboard.press("ArrowUp")
    comes_to(page, 1, y + 0.1)
    page.keyboard.press("PageUp")
    comes_to(page, 2, z + 0.1)


def test_arrow_keys_move_nothing_outside_the_pad(visit: Open) -> None:
    page = connected(visit())
    before = place(page)
    for focused in (page.get_by_role("button", name="X +"), page.get_by_role("tab").first):
        focused.focus()
        page.keyboard.press("ArrowUp")
        page.keyboard.press("PageDown")
    page.wait_for_timeout(500)
    assert place(page) == before


def test_a_refused_move_is_explained_beside_the_pad(visit: Open) -> None:
    page = connected(visit())
    page.get_by_role("radio", name="10 mm", exact=True).click()
    for _ in range(6):
        page.get_by_role("button", name="X −").click()
        page.wait_for_timeout(400)
    pad = card(page, "Move by hand")
    expect(pad.get_by_text("is outside 0 to 200 mm")).to_be_visible(timeout=10_000)
    assert place(page)[0] >= 0


def test_console_shows_replies_and_refusals_and_remembers(visit: Open) -> None:
    page = tab(connected(visit()), "Console")
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


def test_another_browser_sees_what_is_typed_as_text_and_moves_nothing(
    visit: Open, browser: Browser, server: Process
) -> None:
    page = tab(connected(visit()), "Console")
    other = browser.new_context().new_page()
    try:
        other.goto(f"{server.url.rstrip('/')}/printer?tab=console")
        typed(page, "M117 <b id=evil>hello</b>")
        for one in (page, other):
            expect(one.get_by_role("log").get_by_text("<b id=evil>").first).to_be_visible(
                timeout=20_000
            )
            assert one.locator("#evil").count() == 0
        before = place(page)
        other.wait_for_timeout(800)
        other.get_by_role("button", name="X +").click()
        expect(other.get_by_text("holds the controls").first).to_be_visible(timeout=10_000)
        assert place(page) == before
    finally:
        other.context.close()


def test_a_macro_is_written_run_and_seen_in_the_console(visit: Open) -> None:
    page = connected(visit(address="?tab=console"))
    macros = card(page, "Macros")
    expect(macros.get_by_text("generic_marlin has none yet")).to_be_visible()
    macros.get_by_role("button", name="New macro").click()
    page.get_by_label("Name", exact=True).fill("Where")
    page.get_by_label("Commands, one a line").fill("M114\nM105")
    page.get_by_role("button", name="Save").click()
    macros.get_by_role("button", name="Where", exact=True).click()
    expect(page.get_by_role("log").get_by_text("Count X").last).to_be_visible(timeout=10_000)
    macros.get_by_role("button", name="Edit Where").click()
    page.get_by_label("Commands, one a line").fill("M112")
    page.get_by_role("button", name="Save").click()
    expect(page.get_by_text("line 1: M112 isn't for manual use")).to_be_visible(timeout=10_000)
    page.get_by_role("button", name="Remove").click()
    expect(macros.get_by_text("generic_marlin has none yet")).to_be_visible()


def test_needle_is_touched_off_by_three_readings(visit: Open) -> None:
    page = connected(visit(address="?tab=needle"))
    card(page, "Needle offset and bath level").get_by_role("button", name="Name the parts").click()
    for label, option in (("Needle", "25g"), ("Dish", "petri_60mm"), ("Ink", "collagen_fresh")):
        chosen(page, label, option)
    page.get_by_role("button", name="That is mounted").click()
    touch = card(page, "Needle offset and bath level")
    expect(touch.get_by_text("to be touched off before the next print")).to_be_visible()
    touch.get_by_role("button", name="Touch off the floor").click()
    use = touch.get_by_role("button", name="Use this height")
    for count in (1, 2, 3):
        expect(use).to_have_count(0)
        touch.get_by_role("button", name="take this reading").click()
        expect(touch.get_by_text(f"{count} of {3 if count < 3 else count} readings")).to_be_visible(
            timeout=10_000
        )
    use.click()
    expect(touch.get_by_text("Needle 25g: floor Z")).to_be_visible(timeout=10_000)
    expect(card(page, "Move by hand").get_by_text("rim ")).to_be_visible()


def test_a_new_syringe_sets_zero_and_is_purged(visit: Open) -> None:
    page = connected(visit())
    page.get_by_role("button", name="New syringe").click()
    page.get_by_role("button", name="It is up: next").click()
    page.get_by_label("Filled with").fill("600")
    page.get_by_role("button", name="It is in, the plunger touched: zero").click()
    page.get_by_role("button", name="Push 1 µL").click()
    expect(page.get_by_text("1 µL pushed out")).to_be_visible(timeout=20_000)
    page.get_by_role("button", name="It comes clean: next").click()
    done = page.get_by_role("button", name="Done", exact=True)
    expect(done).to_have_count(0)
    page.get_by_role("checkbox", name="Wiped").click()
    done.click()
    ink = card(page, "Ink in the syringe")
    expect(ink.get_by_text("µL left")).to_be_visible()
    expect(ink.get_by_role("button", name="Push", exact=True)).to_be_enabled()


def test_weighing_makes_a_job_and_reads_the_balance(visit: Open) -> None:
    page = connected(visit(address="?tab=calibration"))
    page.get_by_role("button", name="Start: Flow by weight").click()
    page.get_by_label("Syringe").select_option("hamilton_1ml")
    page.get_by_role("button", name="Make the test's G-code").click()
    expect(page.get_by_text("file~calibrate_weigh_")).to_be_visible(timeout=20_000)
    for row in range(1, 13):
        travel = page.get_by_label(f"travel_mm, row {row}", exact=True).input_value()
        page.get_by_label(f"mass_mg, row {row}", exact=True).fill(f"{float(travel) * 17:.2f}")
    page.reload()  # an hour at the balance: the sheet is still there
    page.get_by_role("button", name="Start: Flow by weight").click()
    page.get_by_role("button", name="What do they say?").click()
    expect(page.get_by_text("volume per travel")).to_be_visible(timeout=10_000)
    page.get_by_text("Write it into a copy of a profile").click()
    page.get_by_label("Name of the copy").fill("weighed_here")
    page.get_by_role("button", name="Write the copy").click()
    expect(page.get_by_text("written: steps_per_mm.e")).to_be_visible(timeout=10_000)


def test_a_print_locks_the_page_and_after_a_stop_it_says_what_to_do(
    visit: Open, workspace: Path
) -> None:
    page = connected(visit())
    station = attach_station(workspace / "station")
    station.mount(needle="", dish="")
    station.set_position(0, 0, 0)
    folder = workspace / "runs" / "slow"
    folder.mkdir(parents=True)
    moves = "".join(f"G1 X{10 + i % 2} F60\n" for i in range(3000))
    (folder / "part.gcode").write_text(f"G90\nG92 X0 Y0 Z0\n{moves}")
    order = Order(folder / "part.gcode", "generic_marlin", "", folder / "print", Retreat())
    station.print(order).detach()
    station.detach()
    link = page.get_by_role("link", name="To the Job page")
    expect(link).to_have_attribute("href", "/job")
    expect(card(page, "Move by hand")).to_have_count(0)
    main = page.get_by_role("main")
    expect(main.get_by_role("button")).to_have_text(["Console"])  # it can be unfolded
    page.get_by_role("button", name="EMERGENCY STOP", exact=True).click()
    halted = page.get_by_role("heading", name="The printer has halted")
    expect(halted).to_be_visible(timeout=30_000)
    page.get_by_role("button", name="Reconnect").click()
    expect(page.get_by_text("ready: connected, checked")).to_be_visible(timeout=90_000)
    by_hand = card(page, "Move by hand")
    expect(by_hand.locator("dd .unknown s")).to_have_count(3)  # struck through
    expect(by_hand.get_by_text("Position unknown: X, Y, Z not homed since")).to_be_visible()
    ink = card(page, "Ink in the syringe")
    expect(ink.get_by_text("Ink left unknown: ").or_(ink.locator(".big")).first).to_be_visible()
    page.get_by_role("button", name="Where the tip is").click()
    expect(page.get_by_role("dialog").get_by_label("X", exact=False).first).to_have_value("")


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
            page.get_by_role("button", name="Disconnect").click()
            expect(page.get_by_role("button", name="Connect", exact=True)).to_be_visible(
                timeout=30_000
            )
    finally:
        page.close()
