"""Camera and time-lapse on the Job page, in a real browser."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from printctl.machine.link import LinkState
from printctl.web.core import Core
from printctl.web.job.service import JobService
from tests.printctl.web.job.camera.pictures import sequence, until
from tests.printctl.web.job.conftest import OPERATOR, add, ready
from tests.printctl.web.serving import server_process
from tests.printctl.web.shell.browsers import WIDE, serious, shown

pytestmark = pytest.mark.browser
_WIDTH = "document.querySelector('.job-camera')?.naturalWidth"
_PLAYS = "document.querySelectorAll('.job-camera')[1]?.naturalWidth === 320"


def _printed(core: Core, source: str) -> str:
    """Print a job with a camera, and wait for its film."""
    service = JobService(replace(core, settings=replace(core.settings, camera=source)))
    try:
        job = add(service)
        until(lambda: service.watching.seen().state == "there")
        service.start(OPERATOR, job, ready(service, job), "generic_marlin on simulated")

        def filmed() -> bool:
            heard = service.heard(job)
            over = heard is not None and heard.status.state is LinkState.DONE
            return over and service.watching.timelapse(job, heard).film

        until(filmed, 60.0)
        return job
    finally:
        service.close()


@pytest.mark.slow
def test_the_camera_is_seen_lost_and_found_and_the_film_plays(
    core: Core, station: Any, browser: Any, tmp_path: Path
) -> None:
    source = sequence(tmp_path / "seen")
    job = _printed(core, source)
    with server_process(core.workspace.root, "--camera", source) as server:
        page = shown(browser, f"{server.url}/job?job={job}", viewport=WIDE, color_scheme="dark")
        page.wait_for_function(f"{_WIDTH} === 320")
        first = page.get_attribute(".job-camera", "src")
        page.wait_for_function(
            "first => document.querySelector('.job-camera').getAttribute('src') !== first",
            arg=first,
        )
        page.get_by_text("Download the time-lapse (WebP)").wait_for()
        page.locator(".job-camera").nth(1).scroll_into_view_if_needed()
        page.wait_for_function(_PLAYS)
        assert serious(page) == []
        page.screenshot(path=str(tmp_path / "camera.png"), full_page=True)
        shutil.rmtree(tmp_path / "seen")
        page.get_by_text("no picture from").wait_for()
        page.wait_for_selector(".job-camera >> nth=0", state="hidden")
        sequence(tmp_path / "seen")
        page.wait_for_selector(".job-camera >> nth=0", state="visible")
        with page.expect_download() as downloading:
            page.get_by_text("Download the time-lapse (WebP)").click()
        assert downloading.value.suggested_filename == "zigzag_timelapse.webp"
    (core.workspace.root / "jobs" / "a.gcode").write_text("G90\nG1 X50 Y50 Z10 F600\n")
    with server_process(core.workspace.root) as server:  # the film stays, without a camera
        page = shown(browser, f"{server.url}/job?job={job}")
        page.get_by_text("Download the time-lapse (WebP)").wait_for()
        page = shown(browser, f"{server.url}/job?job=file~a.gcode")
        page.get_by_text("Set-up and preflight").wait_for()
        assert page.get_by_role("heading", name="Camera").count() == 0
