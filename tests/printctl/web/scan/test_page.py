"""The Scan page in a browser: add, ask, slices, result, report."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from printctl.web.workspace import Workspace
from tests.printctl.web.serving import server_process
from tests.printctl.web.shell.browsers import WIDE, shown

pytestmark = pytest.mark.browser

HOSTILE = "<img src=x onerror=document.title='bad'>"
SAID = {"voxel_mm": [0.03, 0.02, 0.01], "modality": "microct", "scale": "linear"}
VERDICT = {"passed": False, "undecided": False, "reasons": [f"Vessel 7 is closed {HOSTILE}"]}


def _volume(path: Path) -> None:
    volume = np.random.default_rng(3).integers(0, 200, (20, 30, 40), dtype=np.uint8)
    tifffile.imwrite(path, volume, photometric="minisblack")


def _registered(folder: Path) -> None:
    folder.mkdir(parents=True)
    vessels = [
        {"name": k, "kind": "artery", "designed_um": 300.0, "measured_um": 300.0 - k,
         "error_percent": -k / 3, "rms_um": 4.0, "offset_um": 2.0, "open": k != 7,
         "decision": "fail" if k == 7 else "pass"}
        for k in range(30)
    ]  # fmt: skip
    numbers = {"transform_scan_to_part": np.eye(4).tolist(), "scale": [1.0] * 3, "vessels": vessels}
    (folder / "registration.json").write_text(json.dumps(numbers))
    (folder / "report.json").write_text(json.dumps({"verdict": VERDICT}))
    (folder / "vessels.csv").write_text("vessel\n")
    long = "<p style='height:20000px'>The report</p>"
    (folder / "report.html").write_text(f'<html lang="en"><head></head><body>{long}</body></html>')


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("scans")
    workspace = Workspace(folder / "ws").make()
    _volume(workspace.root / "scans" / "chip_7.tif")
    (workspace.root / "scans" / "chip_7.json").write_text(json.dumps(SAID))
    (workspace.root / "scans" / "not shown.tif").write_text("")
    _registered(workspace.root / "runs" / "chip" / ".registered" / "file~chip_7.tif")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PRINTCTL_DATA", str(folder / "data"))
        with server_process(workspace.root) as server:
            yield server.url


def test_what_a_scan_lacks_is_asked_for_and_then_its_slices_are_seen(
    browser: Any, served: str, tmp_path: Path
) -> None:
    page = shown(browser, f"{served}/scan?run=new", own=True)
    page.get_by_role("heading", name="Scan the part, then drop the scan here").wait_for()
    _volume(tmp_path / "part.tif")
    page.locator("input[type=file]").set_input_files(tmp_path / "part.tif")
    page.get_by_text("doesn't say the voxel size").wait_for()
    for axis, size in (("Voxel along x", "10"), ("along y", "20"), ("along z", "30")):
        page.get_by_label(axis, exact=True).fill(size)
    page.get_by_label("Grey values").select_option(label="linear intensity")
    assert page.get_by_label("Refractive index").is_hidden()
    page.get_by_label("Scanned by").select_option(label="OCT")
    page.get_by_label("Refractive index").wait_for()
    page.get_by_label("Scanned by").select_option(label="micro-CT")
    page.get_by_role("button", name="Keep and show the scan").click()
    page.get_by_text("0.4 × 0.6 × 0.6 mm").wait_for()
    page.get_by_role("img", name="From above (along z): slice 11 of 20").wait_for()
    slider = page.get_by_label("From above (along z)")
    slider.press("ArrowRight")
    with page.expect_response("**/slices/z/12?*"):
        slider.press("ArrowRight")
    page.get_by_role("button", name="Delete").click()
    page.get_by_role("dialog").get_by_role("button", name="Delete").click()
    page.get_by_role("link", name="part.tif").wait_for(state="detached")


def test_verdict_stands_first_as_text(browser: Any, served: str) -> None:
    page = shown(browser, f"{served}/scan?scan=file~chip_7.tif", own=True)
    page.get_by_text("Not passed").wait_for()
    assert HOSTILE in page.inner_text("body")


def test_worst_vessel_stands_first_until_another_order_is_asked_for(
    browser: Any, served: str
) -> None:
    page = shown(browser, f"{served}/scan?scan=file~chip_7.tif", own=True)
    page.get_by_role("tab", name="Vessels (30)").click()
    first = page.get_by_role("region", name="Vessels").locator("tbody tr").first
    assert first.inner_text().split()[0] == "7"
    page.get_by_role("button", name="Measured (µm)").click()
    assert first.inner_text().split()[0] == "29"


def test_report_is_as_tall_as_the_window_and_opens_in_a_tab_of_its_own(
    browser: Any, served: str
) -> None:
    page = shown(browser, f"{served}/scan?scan=file~chip_7.tif", own=True)
    page.get_by_role("link", name="Show the report").click()
    frame = page.get_by_title("Report of chip_7.tif with chip")
    frame.content_frame.get_by_text("The report").wait_for()
    assert frame.bounding_box()["height"] >= 0.75 * WIDE["height"]
    assert page.evaluate("document.documentElement.scrollHeight") <= WIDE["height"]
    with page.expect_popup() as opened:
        page.get_by_role("link", name="Open in a tab of its own").click()
    opened.value.get_by_text("The report").wait_for()
    page.get_by_role("link", name="Back").click()
    page.get_by_role("tab", name="Result").wait_for()


def test_refusal_stands_beside_the_button(browser: Any, served: str) -> None:
    page = shown(browser, f"{served}/scan?scan=file~chip_7.tif", own=True)
    page.get_by_role("button", name="Compare with the design").click()
    page.get_by_role("button", name="Register again").click()
    page.get_by_role("alert").filter(has_text="make its design first").wait_for()
