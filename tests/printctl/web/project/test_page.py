"""The guided way in a browser: from the open page to a rehearsed print's report."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import trimesh

from tests.printctl.web.serving import Process, server_process
from tests.printctl.web.shell.browsers import shown
from tests.waiting import wait_for

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Process]:
    with server_process(tmp_path_factory.mktemp("way") / "workspace") as made:
        yield made


def button(page: Any, name: str) -> Any:
    return page.get_by_role("button", name=name, exact=True)


def test_from_the_open_page_to_the_report_in_six_clicks_and_no_text(
    server: Process, browser: Any
) -> None:
    page = shown(browser, f"{server.url}/")
    button(page, "Start from A small tree").click()
    page.get_by_text(re.compile(r"grown in \d+ ms")).wait_for()
    page.get_by_label("Ends").press("ArrowLeft")  # a slider is moved; nothing is typed
    button(page, "Save and make it").wait_for()
    button(page, "Save and make it").click()
    page.get_by_role("heading", name="checks let it be printed").wait_for(timeout=120_000)
    button(page, "Next: print or rehearse").click()
    page.get_by_label("How fast").select_option("100")
    button(page, "Rehearse").click()
    page.get_by_role("heading", name="Rehearsing").wait_for()
    address = page.url
    page.goto(f"{server.url}/")  # whoever leaves and comes back finds it where it was
    page.goto(address)
    page.get_by_role("heading", name="The rehearsal is as designed").wait_for(timeout=240_000)
    page.frame_locator("iframe[title=Report]").get_by_text("Pass").first.wait_for()
    stopped_while_rehearsed_again(page)


def stopped_while_rehearsed_again(page: Any) -> None:
    """The report of the rehearsal before isn't the stopped one's."""
    page.get_by_role("navigation", name="Steps").get_by_role("link", name="Print").click()
    page.get_by_label("How fast").select_option("1")
    button(page, "Rehearse again").click()
    wait_for(lambda: "printing" in page.locator("#pc-print").inner_text(), 120)
    page.keyboard.press("Escape")
    page.keyboard.press("Escape")
    page.get_by_text("The last rehearsal didn't come to its end").wait_for()
    page.reload()
    page.get_by_text("The last rehearsal didn't come to its end").wait_for()
    assert page.get_by_text("is as designed").count() == 0


def test_a_dialog_leaves_stop_in_reach_and_gives_the_focus_back(
    server: Process, browser: Any, tmp_path: Path
) -> None:
    page = shown(browser, f"{server.url}/")
    (tmp_path / "tree.csv").write_text("x,y,z,radius,parent\n0,0,0,0.3,-1\n9,0,0,0.3,0\n")
    page.locator("input[type=file]").first.set_input_files(tmp_path / "tree.csv")
    dialog = page.get_by_role("dialog", name="Begin with tree.csv")
    dialog.wait_for()
    on_top = """e => {
      const { x, y } = e.getBoundingClientRect();
      return e === document.elementFromPoint(x + 9, y + 9);
    }"""
    assert page.locator("#pc-stop").evaluate(on_top), "EMERGENCY STOP lies above the dialog"
    page.evaluate("document.getElementById('pc-stopped').hidden = false")  # as a stop shows it
    banner, box = page.locator("#pc-stopped").bounding_box(), dialog.bounding_box()
    assert banner is not None
    assert box is not None
    assert box["y"] >= banner["y"] + banner["height"], "the banner covers no dialog"
    page.evaluate("document.getElementById('pc-stopped').hidden = true")
    dialog.get_by_label("Unit of the file").select_option("mm")
    dialog.get_by_label("Name of the project").fill("../../etc")
    button(page, "Begin").click()
    dialog.get_by_role("alert").wait_for()
    assert "../../etc" in dialog.get_by_role("alert").inner_text()
    assert dialog.get_by_label("Name of the project").input_value() == "../../etc", "kept"
    page.keyboard.press("Escape")
    dialog.wait_for(state="hidden")


def test_a_mesh_asks_for_unit_needle_inlet_and_smallest_vessel(
    server: Process, browser: Any, tmp_path: Path
) -> None:
    trimesh.creation.box((1.2, 0.9, 0.7)).export(tmp_path / "heart.stl")
    page = shown(browser, f"{server.url}/")
    page.locator("input[type=file]").first.set_input_files(tmp_path / "heart.stl")
    dialog = page.get_by_role("dialog", name="Begin with heart.stl")
    for unit, size in (("cm", "12 × 9 × 7 mm"), ("in", "30.5 × 22.9 × 17.8 mm")):
        dialog.get_by_label("Unit of the file").select_option(unit)
        dialog.get_by_text(f"The shape is {size} large").wait_for()
    dialog.get_by_label("Needle").select_option("27g")
    dialog.get_by_label("Smallest vessel").fill("0.4")
    dialog.get_by_label("Where the vessels enter").select_option("top")
    button(page, "Begin").click()
    page.get_by_role("heading", name="heart", exact=True).wait_for()


def test_a_project_that_is_not_there_says_so(server: Process, browser: Any) -> None:
    page = shown(browser, f"{server.url}/project?name=none")
    page.get_by_text("there is no recipe 'none'").wait_for()
    assert page.locator("#pc-stop").is_visible()
