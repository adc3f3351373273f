"""The report as a page and as PDF."""

import base64
import hashlib
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import html
from matplotlib import rcParams
from pypdf import PdfReader

from report import ReportError, ReportSurface, print_page, write_report_html
from report.gcode import layer_figure
from report.gcode.colouring import colourings
from report.wording import number
from tests.printctl.web.shell.browsers import CHROMIUM

from .gcode_sample import layered_job
from .sample import block_surface, deviation_surface, planar_network, sample_data


def layer_picture() -> bytes:
    job = layered_job()
    return layer_figure(job, 0, colourings(job)[0])


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> str:
    return written_whole(tmp_path_factory.mktemp("report") / "report.html")


def written_whole(path: Path) -> str:
    layer = layer_picture()
    surfaces = [deviation_surface(0.4), block_surface()]
    figures = {"toolpath/Layer 1 of 50": layer, "Anything else": layer}
    write_report_html(path, sample_data(), surfaces, planar_network(), figures)
    return path.read_text(encoding="utf-8")


def written(tmp_path: Path, data: dict[str, Any], **more: Any) -> Any:
    path = tmp_path / "report.html"
    surfaces, network = more.pop("surfaces", []), more.pop("network", None)
    write_report_html(path, data, surfaces, network, **more)
    return html.fromstring(path.read_text(encoding="utf-8"))


def words(page: Any) -> str:
    return " ".join(page.text_content().split())


def test_nothing_is_fetched_and_the_policy_forbids_it(whole: str) -> None:
    page = html.fromstring(whole)
    for attribute in ("src", "href", "data", "action", "srcset", "poster"):
        for value in page.xpath(f"//@{attribute}"):
            assert value.startswith(("#", "data:")), value
    assert not page.xpath("//link | //iframe | //object | //embed | //base")
    assert "@import" not in whole
    assert not re.search(r"url\(\s*['\"]?(?!#|data:)", whole)
    modules = json.loads(page.xpath('//script[@type="importmap"]/text()')[0])["imports"]
    assert all(url.startswith("data:text/javascript;base64,") for url in modules.values())
    for name, url in modules.items():
        source = base64.b64decode(url.split(",", 1)[1]).decode()
        if name != "three":
            wanted = re.findall(r'^(?:import|export)[^;]*?from ["\']([^"\']+)["\']', source, re.M)
            assert set(wanted) <= set(modules), name
    policy = page.xpath('//meta[@http-equiv="Content-Security-Policy"]/@content')[0]
    assert "default-src 'none'" in policy
    assert "http" not in policy.replace("http-equiv", "")
    assert "unsafe-inline" not in policy.split("script-src")[1].split(";")[0]
    running = page.xpath('//script[@type!="application/json"]/text()')
    assert len(running) == 2
    for text in running:
        assert base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() in policy


def test_page_is_well_formed(whole: str) -> None:
    assert whole.startswith("<!doctype html>\n<html")
    page = html.fromstring(whole)
    ids = page.xpath("//@id")
    assert len(ids) == len(set(ids))
    assert len(page.xpath("//h1")) == 1
    for target in page.xpath("//nav/a/@href"):
        assert target[1:] in ids
    for table in page.xpath('//table[contains(@class, "data")]'):
        width = len(table.xpath("./thead/tr/th"))
        assert all(len(row.xpath("./td | ./th")) == width for row in table.xpath("./tbody/tr"))


def test_verdict_and_key_figures_lead(whole: str) -> None:
    page = html.fromstring(whole)
    assert page.xpath('//div[contains(@class, "verdict pass")]')
    keys = words(page.xpath('//dl[@class="keys"]')[0])
    for expected in ("38.2 µm", "99.6 %", "14 of 14", "0.093 mmHg", "1 h 13 min", "359 µL"):
        assert expected in keys


def test_failed_verdict_shows_its_reasons(tmp_path: Path) -> None:
    verdict = {"passed": False, "reasons": ["vessel 5 is blocked"]}
    page = written(tmp_path, {"verdict": verdict})
    assert "vessel 5 is blocked" in words(page.xpath('//div[contains(@class, "verdict fail")]')[0])


def emptied(value: Any) -> Any:
    """The same structure with None or NaN for every number."""
    if isinstance(value, dict):
        return {
            k: v if k in ("vessel", "histogram", "transform_scan_to_part") else emptied(v)
            for k, v in value.items()
        }
    if isinstance(value, list):
        return [emptied(v) for v in value]
    if isinstance(value, bool | str):
        return value
    return None if isinstance(value, int) else math.nan


def test_missing_numbers_show_as_dashes(tmp_path: Path) -> None:
    page = written(tmp_path, emptied(sample_data()), network=planar_network())
    text = words(page.xpath("//main")[0])
    assert "–" in text
    assert not re.search(r"\b(nan|NaN|None|null|Undefined)\b", text)
    block = page.xpath('//script[@id="view-data"]/text()')[0]
    assert json.loads(block, parse_constant=pytest.fail)["network"]


HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)><!-- '\"&"


def hostile(value: Any) -> Any:
    """The same structure with every text replaced by an attack."""
    if isinstance(value, dict):
        return {k: HOSTILE if k == "vessel" else hostile(v) for k, v in value.items()}
    if isinstance(value, list):
        return [hostile(v) for v in value]
    return HOSTILE if isinstance(value, str) else value


def test_names_are_shown_as_text(tmp_path: Path) -> None:
    data = hostile(sample_data())
    data["frames"] = {HOSTILE: {HOSTILE: HOSTILE}}
    data["provenance"] = {HOSTILE: {HOSTILE: HOSTILE}}
    data["timings"] = {HOSTILE: {"seconds": 1.0}}
    data["registration"]["rigid"]["within"] = {HOSTILE: 0.5}
    block = block_surface()
    values = np.arange(8.0)
    surface = ReportSurface(HOSTILE, block.surface, values, HOSTILE)
    figures = {HOSTILE: layer_picture()}
    page = written(tmp_path, data, surfaces=[surface], network=planar_network(), figures=figures)
    kinds = [s.get("type") for s in page.xpath("//script")]
    assert kinds == ["importmap", "application/json", "module"]
    assert not page.xpath("//img[@onerror] | //*[@onload] | //*[@onclick]")
    assert page.xpath("//h1/text()")[0] == HOSTILE
    view = json.loads(page.xpath('//script[@id="view-data"]/text()')[0])
    assert view["surfaces"][0]["name"] == HOSTILE
    assert view["surfaces"][0]["unit"] == HOSTILE
    assert HOSTILE in page.xpath('//table[@id="vessels-table"]')[0].text_content()


def test_same_input_gives_the_same_bytes(whole: str, tmp_path: Path) -> None:
    before = dict(rcParams)
    assert written_whole(tmp_path / "again.html") == whole
    assert dict(rcParams) == before


LOOK = {
    "look": 5, "mark": "end of layer 4", "way_mm": 162.8, "judged": 0.7, "ink": 0.858,
    "mended": True, "gaps_mm": 0.9, "scan_known": 1.0, "scan_ink": 0.885, "scan_missing_mm": 16.3,
    "agree": False, "words": "look: mended; scan: missing",
}  # fmt: skip


def test_looks_stand_beside_the_final_scan_and_those_that_disagree_first(tmp_path: Path) -> None:
    fine = LOOK | {"look": 1, "agree": True, "words": "look: whole; scan: whole"}
    page = written(tmp_path, sample_data() | {"looks": [fine, LOOK]})
    (table,) = page.xpath("//table[@id='looks-table']")
    first, second = (
        [cell.text_content().strip() for cell in row] for row in table.xpath("./tbody/tr")
    )
    assert (first[0], first[-2:]) == ("5", ["no", "look: mended; scan: missing"])
    assert (second[0], second[-2:]) == ("1", ["yes", "look: whole; scan: whole"])
    assert "16.3" in first
    assert "Looks held against the final scan" in words(page)


# Shared parts of pages and figures: head, scripts, small multiples, caching.


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"), (math.nan, "–"), (math.inf, "–"), (True, "–"), (0, "0"), (0.0, "0"),
        (-3, "\u22123"), (123456, "123\u202f456"), (12.3456, "12.35"), (0.00123456, "0.001235"),
        (-0.5, "\u22120.5"), (1234567.0, "1\u202f234\u202f567"), (2.5e-7, "2.500·10⁻⁷"),
        (1e12, "1.000·10¹²"),
    ],
)  # fmt: skip
def test_numbers(value: Any, text: str) -> None:
    assert number(value) == text


def gauged() -> dict[str, Any]:
    """A registration of two vessels, one with a stenosis and a bridge to the other."""
    along = [0.1 * i for i in range(30)]
    vessels = [
        {"vessel": v, "designed_um": 500.0, "measured_um": 490.0, "error_percent": -2.0,
         "length_mm": 3.0, "open": True, "along_mm": along, "unseen_mm": [[2.8, 3.0]],
         "diameter_um": [490.0 if v or not 10 < i < 14 else 250.0 for i in range(30)]}
        for v in (0, 1)
    ]  # fmt: skip
    stenosis = {
        "kind": "stenosis", "vessel": 0, "other": None, "from_mm": 1.0, "to_mm": 1.5,
        "at_mm": 1.2, "point_mm": [1.2, 0.5, 0.25], "size_um": -240.0, "error_um": 4.0,
        "percent": -49.0, "wall_um": -121.0, "seen": True,
        "made_by": {"layers": [3, 4, 5, 6], "first_line": 40, "last_line": 71, "line_count": 9},
    }  # fmt: skip
    bridge = stenosis | {
        "kind": "bridge", "other": 1, "size_um": 210.0, "percent": None, "wall_um": None,
        "made_by": {"layers": [], "first_line": 0, "last_line": 0, "line_count": 0},
    }  # fmt: skip
    betti = {"components": 1, "loops": 3, "cavities": 0, "euler": -2}
    flow = {"vessel": 0, "resistance_pa_s_ul": 3.0, "designed_resistance_pa_s_ul": 1.5,
            "share": 0.3, "designed_share": 0.5, "measured": True, "fed": True}  # fmt: skip
    return {
        "vessels": vessels,
        "defects": [stenosis, bridge],
        "rigid_model_to_scan": {"rms_um": 50.0, "p95_um": 90.0},
        "scaled_model_to_scan": {"rms_um": 8.0, "p95_um": 14.0},
        "hausdorff_p95_um": {"rigid": 95.0, "scaled": 14.5},
        "overlap": {
            "rigid": {"dice": 0.93, "volume_ratio": 0.94},
            "scaled": {"dice": 0.98, "volume_ratio": 0.955},
        },
        "topology": {
            "designed": betti, "printed": betti | {"loops": 4}, "as_designed": False,
            "explained": True,
        },
        "perfusion": {
            "perfused": None, "pressure_drop_pa": 12.0, "designed_pressure_drop_pa": 10.0,
            "vessels": [flow, flow | {"vessel": 1, "resistance_pa_s_ul": None, "fed": False}],
        },
        "within_curve": {
            "tolerance_um": [0, 50, 100], "rigid": [0, 0.5, 1], "scaled": [0, 0.9, 1],
        },
        "by_layer": [
            {"layer": k, "z_mm": 0.06 * k, "mean_um": -5.0, "rms_um": 9.0} for k in range(5)
        ],
        "model_seen_fraction": 0.97,
    }  # fmt: skip


def test_the_page_shows_it_all(tmp_path: Path) -> None:
    write_report_html(tmp_path / "a.html", {"registration": gauged()}, [], None)
    page = html.fromstring((tmp_path / "a.html").read_text(encoding="utf-8"))
    text = " ".join(page.text_content().split())
    for words in ("Findings", "Does it still perfuse?", "95 % Hausdorff", "any tolerance",
                  "each written layer", "Diameter along the vessels"):  # fmt: skip
        assert words in text, words
    assert len(page.xpath('//table[@id="defects-table"]/tbody/tr')) == 2


def whole_sample() -> dict[str, Any]:
    data = sample_data()
    data["printed"] = {"id": "p-7", "started": 1795209018.9, "gcode_sha256": "ff" * 32}
    data["registration"] |= {
        "scale": [0.9962, 0.997, 1.0],
        "interval_95": {
            "scale": [0.00047, 0.0007, None],
            "offset_um": 1.3,
            "shift_um": [1.0, 2.0, 3.0],
            "rotation_deg": [0.0069, 0.0029, 0.021],
        },
        "offset_um": -8.5,
        "walls": None,
        "design": {"network_sha256": "d" * 64},
    }
    return data


@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason="chromium isn't installed")
def test_a_printed_report_says_what_its_page_says(tmp_path: Path) -> None:
    page, pdf = tmp_path / "a report.html", tmp_path / "ü.pdf"
    write_report_html(page, whole_sample(), [], planar_network())
    print_page.print_page(page, pdf)
    assert sorted(one.name for one in tmp_path.iterdir()) == [page.name, pdf.name]
    reader = PdfReader(pdf)
    assert [float(side) for side in reader.pages[0].mediabox[2:]] == pytest.approx(
        [595, 842], abs=1
    )
    texts = [one.extract_text() for one in reader.pages]
    for k, text in enumerate(texts):
        assert f"{k + 1} / {len(texts)}" in text
    # Where a sign comes from another font than the digits, the reader puts a space between them.
    words = "".join("".join(texts).split())
    for said in ("planar_fresh", "Pass", "0.99620", "± 0.00047", "not fitted", "−8.50",
                 "Rotation about z / °", "p-7", "2026-11-20 21:10 UTC",
                 "ff" * 32, "d" * 64):  # fmt: skip
        assert said.replace(" ", "") in words, said
    # Vessels in three dimensions, drawn without a graphics card.
    assert any(len(one.images) for one in reader.pages)


@pytest.mark.parametrize(
    ("script", "limit_s", "why"),
    [
        ("echo sandbox >&2", 60.0, r"wrote no PDF \(sandbox\)"),
        ("exec sleep 60", 0.2, "within 0.2 s"),
    ],
)
def test_a_browser_that_fails_or_hangs_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, limit_s: float, why: str
) -> None:
    browser, pdf = tmp_path / "chromium", tmp_path / "a.pdf"
    browser.write_text(f"#!/bin/sh\n{script}\n")
    browser.chmod(0o755)
    pdf.write_bytes(b"old")
    monkeypatch.setattr(print_page, "find_browser", lambda: str(browser))
    monkeypatch.setattr(print_page, "TIME_LIMIT_S", limit_s)
    with pytest.raises(ReportError, match=why):
        print_page.print_page(tmp_path / "a.html", pdf)
    assert pdf.read_bytes() == b"old"
    assert sorted(one.name for one in tmp_path.iterdir()) == ["a.pdf", "chromium"]
