"""The History page in a browser, with hostile text in every field."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from printctl.web.workspace import Workspace
from tests.printctl.history.records.prints import printed, with_run
from tests.printctl.web.serving import server_process
from tests.printctl.web.shell.browsers import shown, until

pytestmark = pytest.mark.browser

HOSTILE = "<img src=x onerror=document.title='bad'>{{7*7}}<script>document.title='bad'</script>"


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path]]:
    folder = tmp_path_factory.mktemp("page")
    runs = Workspace(folder / "ws").make().root / "runs"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PRINTCTL_DATA", str(folder / "data"))
        for k in range(12):
            printed(runs / f"chip_{k}", "part.gcode", 1e9 + k, "killed" if k == 7 else "done")
        printed(folder / "elsewhere", "other.gcode", 1.5e9)
        _hostile(runs / "hostile")
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
    printed(folder, "part.gcode", 2e9, message=HOSTILE, alarm=HOSTILE, who=HOSTILE)
    with_run(folder)
    verdict = {"passed": False, "undecided": False, "reasons": [HOSTILE]}
    (folder / "report.json").write_text(json.dumps({"verdict": verdict}))


def _names(page: Any) -> list[str]:
    names: list[str] = (
        page.get_by_role("region", name="Prints").get_by_role("link").all_inner_texts()
    )
    return names


def test_list_is_of_the_workspace_searched_and_turned_by_pages(
    browser: Any, served: tuple[str, Path]
) -> None:
    page = shown(browser, f"{served[0]}/history", own=True)
    page.get_by_text("13 prints").wait_for()
    assert len(_names(page)) == 10
    page.get_by_role("button", name="Next page").click()
    page.get_by_text("page 2 of 2").wait_for()
    until(page, "document.querySelectorAll('tbody tr').length === 3")
    page.get_by_role("radio", name="All of this account").click()
    page.get_by_text("14 prints").wait_for()
    assert _names(page)[:2] == ["hostile", "other.gcode"]
    page.get_by_label("Search").fill("killed")
    page.get_by_text("1 print", exact=True).wait_for()
    page.wait_for_url("**/history?words=killed&of=all")
    page.reload()
    page.get_by_text("1 print", exact=True).wait_for()
    assert _names(page) == ["chip_7"]
    with page.expect_download() as saved:
        page.get_by_role("link", name="Export as CSV").click()
    assert Path(saved.value.path()).read_text().count("\n") == 2
    page.get_by_text("Narrow and order").click()
    page.get_by_label("End", exact=True).select_option("done")
    page.get_by_text("No print fits").wait_for()


def test_hostile_text_is_shown_as_text(browser: Any, served: tuple[str, Path]) -> None:
    page = shown(browser, f"{served[0]}/history", own=True)
    page.get_by_role("link", name="hostile").click()
    page.get_by_role("heading", name="What the operator noted").wait_for()
    text = page.inner_text("body")
    assert text.count("{{7*7}}") >= 8
    assert HOSTILE in text
    assert page.locator("img[src=x]").count() == 0
    assert page.title() == "History · printctl"


def test_print_is_compared_filed_verified_and_made_ready_again(
    browser: Any, served: tuple[str, Path], tmp_path: Path
) -> None:
    url, folder = served
    page = shown(browser, f"{url}/history?words=chip_3", own=True)
    page.get_by_role("link", name="chip_3").click()
    with page.expect_download() as saved:
        page.get_by_role("link", name="Download the record").click()
    record = tmp_path / "record.zip"
    saved.value.save_as(record)
    page.get_by_role("button", name="Compare with today").click()
    page.get_by_role("button", name="Make the job").click()
    page.get_by_role("link", name="Go to the job").wait_for()
    assert (folder / "ws" / "jobs" / "part_again_1.gcode").is_file()
    page.get_by_role("link", name="All prints").click()
    page.get_by_role("button", name="Verify a record").click()
    chosen = page.get_by_label("Choose a record (zip)")
    chosen.set_input_files(record)
    page.get_by_text("WHOLE: every file is as it was filed").wait_for()
    page.get_by_text("SIGNED by the trusted key").wait_for()
    data = bytearray(record.read_bytes())
    data[data.index(b"a comment")] ^= 1
    record.write_bytes(data)
    chosen.set_input_files(record)
    page.get_by_text("job.gcode: changed").wait_for()
