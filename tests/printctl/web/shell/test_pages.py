"""Frame of every web page, in a real browser."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.printctl.web.printing import ended_by_kill, under_way
from tests.printctl.web.serving import Process, server_process
from tests.printctl.web.shell.browsers import PHONE, TABLET, WIDE, serious, shown, until
from tests.slower import first_of

pytestmark = pytest.mark.browser
PAGES = ("/printer", "/design", "/job", "/scan", "/history")
DIALOG = """() => {
  const dialog = document.createElement("div");
  dialog.innerHTML = '<div style="position:fixed;inset:0;z-index:6000;background:#0008">'
    + '<input id="in-dialog"></div>';
  document.body.append(dialog);
  const field = document.getElementById("in-dialog");
  field.addEventListener("keydown", (event) => event.stopPropagation());
  field.focus();
}"""


@pytest.fixture(scope="module")
def served(
    tmp_path_factory: pytest.TempPathFactory, browser: Any
) -> Iterator[tuple[Process, Path]]:
    """A server that wants a password; browsers' shared profile has given it.

    The last test here kills it.
    """
    folder = tmp_path_factory.mktemp("shell")
    secret = folder / "password"
    secret.write_text("bath and needle\n")
    secret.chmod(0o600)
    with server_process(folder / "workspace", "--password-file", str(secret)) as server:
        logged_in(browser.contexts[0], f"{server.url}/printer").close()
        yield server, folder / "workspace"


def logged_in(profile: Any, url: str) -> Any:
    page = profile.new_page()
    page.goto(url)
    page.fill("#password", "bath and needle")
    page.click("button:has-text('Log in')")
    page.wait_for_selector("#pc-take:visible")
    return page


@pytest.fixture(scope="module")
def printer_page(served: tuple[Process, Path], browser: Any) -> Any:
    """One page for tests that don't mind what others did to it: to load one costs seconds."""
    return shown(browser, f"{served[0].url}/printer", viewport=WIDE)


def banner(page: Any) -> str:
    return str(page.text_content("#pc-stopped p"))


def test_the_button_stops_while_the_server_hangs(served: Any, browser: Any) -> None:
    server, workspace = served
    page = shown(browser, f"{server.url}/printer")
    with under_way(workspace, "button") as print_:
        page.wait_for_timeout(1500)  # the door finds the print
        server.halt()
        try:
            page.click("#pc-stop")
            assert ended_by_kill(print_)
            page.locator("#pc-stopped").get_by_text("The printer has halted:").wait_for()
            assert "Sent to 1 printer after" in banner(page)
            until(page, "document.querySelector('#pc-lost').textContent.includes('print goes on')")
        finally:
            server.go_on()
    until(page, "document.querySelector('#pc-lost').hidden")


def test_escape_twice_stops_from_within_a_dialog_while_the_server_hangs(
    served: Any, browser: Any
) -> None:
    server, workspace = served
    page = shown(browser, f"{server.url}/job")
    with under_way(workspace, "keys") as print_:
        page.wait_for_timeout(1500)
        page.evaluate(DIALOG)
        server.halt()
        try:
            page.keyboard.press("Escape")
            page.wait_for_timeout(1300)  # too slow: not twice
            page.keyboard.press("Escape")
            assert not print_.client.status.ended
            page.keyboard.press("Escape")
            assert ended_by_kill(print_)
        finally:
            server.go_on()


@pytest.mark.slow
def test_logged_out_the_page_asks_for_the_password(served: Any, browser: Any) -> None:
    server, _ = served
    page = logged_in(browser.new_context(), f"{server.url}/job")
    assert page.url == f"{server.url}/job"
    page.click("button:has-text('Log out')")
    page.wait_for_selector("#password")


@pytest.mark.slow
def test_all_browsers_see_the_same_holder_of_the_controls(served: Any, browser: Any) -> None:
    server, _ = served
    pages = [
        shown(browser, f"{server.url}/printer"),
        logged_in(browser.new_context(), f"{server.url}/history"),
    ]
    first, second = pages
    first.click("#pc-take")
    first.wait_for_selector("text=You hold the controls")
    second.wait_for_selector("#pc-holder:has-text('Chrome on Linux at this machine')")
    second.click("#pc-take")  # asks whether that is meant
    second.wait_for_selector("#pc-take:has-text('Sure?')")
    second.click("#pc-take")
    second.wait_for_selector("text=You hold the controls")
    first.wait_for_selector("#pc-take:has-text('Take over')")
    second.click("#pc-take")
    for page in pages:
        page.wait_for_selector("text=Controls: nobody")


@pytest.mark.parametrize("way", first_of(PAGES))
def test_the_frame_fits_is_large_enough_to_touch_and_passes_axe(
    served: Any, browser: Any, printer_page: Any, way: str
) -> None:
    here = way == "/printer"
    page = printer_page if here else shown(browser, f"{served[0].url}{way}", viewport=WIDE)
    page.wait_for_timeout(500)
    assert serious(page) == []
    assert page.locator("h1").count() == 1
    assert page.locator("main").count() == 1
    for size in (WIDE, TABLET, PHONE):
        page.set_viewport_size(size)
        page.wait_for_timeout(200)
        assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]
        assert_targets_are_large(page, size)


def assert_targets_are_large(page: Any, size: dict[str, int]) -> None:
    """Header within the screen, its targets 44 px at least; the stop 56, wherever one scrolls."""
    for target in page.query_selector_all(".header a, .header button"):
        if target.is_visible():
            box = target.bounding_box()
            assert box["height"] >= 44, target.text_content()
            assert box["width"] >= 44, target.text_content()
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= size["width"]
    stop = page.query_selector("#pc-stop").bounding_box()
    assert min(stop["height"], stop["width"]) >= 56
    page.evaluate("window.scrollTo(0, 5000)")
    stop = page.query_selector("#pc-stop").bounding_box()
    assert 0 <= stop["y"] < size["height"] / 2
    page.evaluate("window.scrollTo(0, 0)")


def test_a_script_that_slips_into_a_page_does_not_run(browser: Any, printer_page: Any) -> None:
    page = printer_page
    page.evaluate(
        """() => {
          const place = document.createElement("div");
          place.innerHTML = '<img src="data:," onerror="window.slipped = 1">';
          document.body.append(place);
          const script = document.createElement("script");
          script.textContent = "window.slipped = 2";
          document.body.append(script);
        }"""
    )
    page.wait_for_timeout(300)
    assert page.evaluate("window.slipped") is None


def test_without_any_answer_the_page_says_to_cut_the_power(browser: Any, printer_page: Any) -> None:
    page = printer_page
    page.route("**/stop", lambda route: route.abort())
    page.click("#pc-stop")
    until(page, "document.querySelector('#pc-stopped p').textContent.includes('CUT THE PRINTER')")


@pytest.mark.slow
def test_nothing_is_fetched_from_elsewhere(served: Any, browser: Any) -> None:
    server, _ = served
    page = logged_in(browser.new_context(), f"{server.url}/printer")
    asked: list[str] = []
    troubles: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda said: troubles.append(said.text) if said.type == "error" else None)
    page.on("pageerror", lambda problem: troubles.append(str(problem)))
    for way in (*PAGES, "/api/docs"):
        page.goto(server.url + way)
        page.wait_for_timeout(500)
    page.wait_for_selector("text=POST /api/v1/stop")
    assert not [u for u in asked if not u.startswith(("http://127.0.0.1:", "data:", "blob:"))]
    assert troubles == []


@pytest.mark.slow
def test_the_page_and_its_stop_outlive_a_server_that_is_killed(served: Any, browser: Any) -> None:
    """The last test here."""
    server, workspace = served
    with under_way(workspace) as print_:
        page = shown(browser, f"{server.url}/printer")
        page.wait_for_timeout(1500)
        server.process.kill()
        page.wait_for_selector("#pc-lost:not([hidden])")
        page.wait_for_timeout(25_000)  # NiceGUI itself would reload by now
        page.click("#pc-stop")
        assert ended_by_kill(print_)
