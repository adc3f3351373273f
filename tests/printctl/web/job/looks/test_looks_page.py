"""Looks card of the Job page, in a real browser."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from printctl.machine.link.look_book import LookDecision
from printctl.observe.records import answer_of, save_look
from printctl.web.workspace import Workspace
from tests.printctl.web.job.looks.held import JOB, picture, print_held_for_a_look, record
from tests.printctl.web.serving import server_process
from tests.printctl.web.shell.browsers import WIDE, serious, shown

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here"),
]


@pytest.mark.slow
def test_a_look_that_asks_is_shown_and_approved(browser: Any, tmp_path: Path) -> None:
    workspace = Workspace(tmp_path / "workspace").make()
    with print_held_for_a_look(workspace) as client, server_process(workspace.root) as server:
        folder = workspace.print_folder(JOB)
        page = shown(browser, f"{server.url}/job?job={JOB}", viewport=WIDE)
        page.get_by_text("Look 1 at the end of layer 1", exact=True).wait_for()
        page.get_by_text("Proposed: write again what is missing, flow factor 1.06").wait_for()
        page.wait_for_function("document.querySelector('.job-looks .job-look').naturalWidth")
        page.wait_for_function("document.querySelector('.job-strip img')?.naturalWidth === 240")
        assert serious(page) == []
        page.screenshot(path=str(tmp_path / "looks.png"), full_page=True)
        page.get_by_role("button", name="Approve").click()
        page.get_by_text("Approved. If the print is still paused").wait_for()
        assert answer_of(folder, 1) == "approve"
        assert not page.get_by_role("button", name="Go on without").is_visible()
        client.resume()  # as the observer does
        page.get_by_text(": a picture is taken and judged").wait_for()
        page.get_by_text("1: mended, approved").wait_for()
        picture(folder, 2)
        save_look(folder, record(2))
        client.looks.decide(2, LookDecision.GO_ON, "as expected")
        page.get_by_text("2: gone on").wait_for()
