"""Scan page in a real browser: upload, view and register a volume."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.printctl.web.serving import Process, server_process
from tests.printctl.web.shell.browsers import PHONE, serious, shown
from tests.printctl.web.shell.dialogs import serious_in_dialog

pytestmark = pytest.mark.browser
_LONG_MS = 400_000
_RECIPE = {
    "schema": 1,
    "name": "small",
    "tissue": {"shape": "block", "size_mm": [16, 8, 3]},
    "vasculature": {"design": "planar_four_vessel"},
    "toolpath": {"method": "fresh", "needle": "22g", "layer_um": 150, "line_um": 400},
    "scan": {"simulated": "oct", "voxel_um": [60, 60, 30]},
    "registration": {"tolerance_um": 1000},
}


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Process, Path]]:
    root = tmp_path_factory.mktemp("scan")
    run = root / "workspace" / "runs" / "small"
    recipe = root / "small.yaml"
    recipe.write_text(yaml.safe_dump(_RECIPE))
    command = ["run", str(recipe), "--out", str(run), "--until", "scan"]
    subprocess.run([sys.executable, "-m", "printctl", *command], check=True, capture_output=True)
    scan = root / "fresh scan.tif"
    shutil.move(run / "scan.tif", scan)
    with server_process(root / "workspace") as server:
        yield server, scan


def test_a_scan_is_added_seen_and_registered(served: Any, browser: Any) -> None:
    server, scan = served
    page = shown(browser, f"{server.url}/scan")
    page.get_by_text("No scan yet").wait_for()
    page.get_by_role("button", name="Add a scan").click()
    page.get_by_role("button", name="Choose a volume").wait_for()
    assert serious_in_dialog(page) == []
    page.locator("input[type=file]").set_input_files(str(scan))
    page.get_by_text("file~fresh_scan.tif: ").wait_for(timeout=60_000)
    image = page.get_by_alt_text("of the scan along z")
    first = image.get_attribute("src")
    page.wait_for_function(
        "[...document.querySelectorAll('.pc-slice img')].every(one => one.naturalWidth > 10)"
    )
    page.get_by_label("Slice along z").locator("[tabindex]").press("ArrowRight")
    page.wait_for_function(
        "first => document.querySelector('.pc-slice img').getAttribute('src') !== first", arg=first
    )
    page.get_by_text("Tint what is above the threshold").click()
    page.wait_for_function(
        "document.querySelector('.pc-slice img').getAttribute('src').includes('threshold')"
    )
    assert serious(page) == []
    page.get_by_role("button", name="Register", exact=True).click()
    page.get_by_text("Shifted by x, y, z").wait_for(timeout=_LONG_MS)
    assert page.locator("tbody tr").count() >= 14
    report = page.frame_locator('iframe[title="Report of the registration"]')
    page.locator("iframe").scroll_into_view_if_needed()
    report.locator("#viewer[data-state=ready]").wait_for(timeout=60_000)
    assert serious(page) == []
    small = shown(browser, f"{server.url}/scan", viewport=PHONE, color_scheme="dark")
    small.get_by_text("Shifted by x, y, z").wait_for(timeout=60_000)
    assert small.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    assert serious(small) == []
