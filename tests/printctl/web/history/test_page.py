"""The History page in a browser, with hostile text in every field."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.printctl.history.records.prints import printed, with_run
from tests.printctl.web.serving import server_process
from tests.printctl.web.shell.browsers import serious

pytestmark = pytest.mark.browser

HOSTILE = "<img src=x onerror=document.title='bad'>{{7*7}}<script>document.title='bad'</script>"
SIZES = {"desk": (1280, 900), "tablet": (820, 1180), "phone": (390, 844)}


@pytest.fixture(scope="module")
def served(tmp_path_factory) -> Iterator[tuple[str, Path]]:
    folder = tmp_path_factory.mktemp("page")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PRINTCTL_DATA", str(folder / "data"))
        for k in range(60):
            printed(folder / str(k), f"job_{k}.gcode", 1e9 + k, "killed" if k == 7 else "done")
        _hostile(folder / "hostile")
        with server_process(folder / "ws") as server:
            yield server.url, folder


def _hostile(folder: Path) -> None:
    (folder / "print").mkdir(parents=True)
    note = {
        "values": {"operator": HOSTILE, "cells": HOSTILE, HOSTILE: HOSTILE},
        "notes": [{"at": 1e9, "who": HOSTILE, "text": HOSTILE}, HOSTILE],
        "steps": [{"step": HOSTILE}],
    }
    (folder / "print" / "record.json").write_text(json.dumps(note))
    name = HOSTILE.replace("/", "_")[:60]
    printed(folder, "part.gcode", 2e9, message=HOSTILE, alarm=HOSTILE, who=HOSTILE)
    with_run(folder)
    told = {"verdict": {"passed": False, "undecided": False, "reasons": [HOSTILE, name]}}
    (folder / "report.json").write_text(json.dumps(told))


def opened(browser, url: str, size: str = "desk", dark: bool = False):
    width, height = SIZES[size]
    page = browser.contexts[0].new_page()  # of the profile that has the pages' libraries
    page.set_viewport_size({"width": width, "height": height})
    page.emulate_media(color_scheme="dark" if dark else "light")
    page.set_default_timeout(20_000)
    page.goto(url)
    page.wait_for_selector(".ph-card")
    return page


def rows(page) -> list[str]:
    page.wait_for_timeout(100)
    return page.locator(".ph-list tbody tr a").all_inner_texts()


@pytest.mark.slow
def test_list_is_searched_and_turned_by_pages(browser, served):
    page = opened(browser, f"{served[0]}/history")
    page.wait_for_selector("text=61 prints")
    assert len(rows(page)) == 50
    page.get_by_role("button", name="Next page").click()
    page.wait_for_selector("text=page 2 of 2")
    assert len(rows(page)) == 11
    page.get_by_label("Search: words, hash, alarm").fill("killed")
    page.get_by_text("1 print", exact=True).wait_for()
    assert rows(page) == ["job_7.gcode"]
    page.wait_for_url("**/history?words=killed")
    page.reload()
    page.get_by_text("1 print", exact=True).wait_for()
    assert page.get_by_label("Search: words, hash, alarm").input_value() == "killed"
    with page.expect_download() as saved:
        page.get_by_text("Export as CSV").click()
    table = Path(saved.value.path()).read_text()
    assert table.count("\n") == 2
    assert "job_7.gcode" in table


@pytest.mark.slow
def test_hostile_text_is_shown_as_text(browser, served):
    page = opened(browser, f"{served[0]}/history")
    page.wait_for_selector("text=61 prints")
    assert HOSTILE in page.inner_text("body")
    page.get_by_role("link", name="part.gcode").click()
    page.wait_for_selector("text=What the operator noted")
    shown = page.inner_text("body")
    assert shown.count("{{7*7}}") >= 8
    assert HOSTILE in shown
    assert HOSTILE.replace("{{7*7}}", "49") not in shown
    assert page.locator("img[src=x]").count() == 0
    assert page.title() == "History · printctl"


@pytest.mark.slow
def test_print_is_compared_filed_and_made_ready_again(browser, served, tmp_path):
    url, folder = served
    page = opened(browser, f"{url}/history")
    page.get_by_label("Search: words, hash, alarm").fill("job_3.gcode")
    page.get_by_text("1 print", exact=True).wait_for()
    page.get_by_role("link", name="job_3.gcode").click()
    page.wait_for_selector("text=What happened")
    with page.expect_download() as saved:
        page.get_by_text("Download the bundle").click()
    bundle = tmp_path / "b.zip"
    saved.value.save_as(bundle)
    page.get_by_role("button", name="Compare with today").click()
    page.get_by_role("button", name="Make the job").click()
    page.wait_for_selector("text=is ready")
    assert (folder / "ws" / "jobs" / "job_3_again_1.gcode").is_file()
    page.goto(f"{url}/history")
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Choose a bundle (zip)").click()
    chooser.value.set_files(str(bundle))
    page.wait_for_selector("text=WHOLE: every file is as it was filed")
    page.wait_for_selector("text=SIGNED by the trusted key")
    data = bytearray(bundle.read_bytes())
    data[data.index(b"a comment")] ^= 1
    bundle.write_bytes(data)
    page.set_input_files("input[type=file]", str(bundle))
    page.wait_for_selector("text=job.gcode: changed")
    assert list((folder / "ws" / ".printctl" / "bundles").iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("size", ["phone", "tablet", "desk"])
def test_page_fits_the_screen_and_its_targets_the_finger(browser, served, size):
    page = opened(browser, f"{served[0]}/history", size)
    page.wait_for_selector("text=61 prints")
    for step in ("list", "one"):
        if step == "one":
            page.get_by_role("link", name="part.gcode").click()
            page.wait_for_selector("text=What the operator noted")
        assert page.evaluate("document.documentElement.scrollWidth") <= SIZES[size][0]
        small = page.evaluate(
            "[...document.querySelectorAll('#content a, #content button')]"
            ".map(e => [e.innerText, e.getBoundingClientRect().height])"
            ".filter(([t, h]) => h > 0 && h < 43.5)"
        )
        assert small == []


@pytest.mark.slow
@pytest.mark.parametrize("dark", [True, False])
def test_axe_finds_nothing_serious(browser, served, dark):
    page = opened(browser, f"{served[0]}/history", dark=dark)
    page.wait_for_selector("text=61 prints")
    assert serious(page) == []
    page.get_by_role("link", name="part.gcode").click()
    page.wait_for_selector("text=What the operator noted")
    page.get_by_role("button", name="Compare with today").click()
    page.wait_for_selector("text=Make the job")
    assert serious(page) == []
