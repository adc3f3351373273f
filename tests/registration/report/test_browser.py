import json
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from registration.report import NetworkPage, write_network_html, write_report_html
from registration.report.gcode import layer_figure
from registration.report.gcode.colouring import colourings
from registration.report.picture import VesselQuantities, quantities
from tests.printctl.web.shell.browsers import CHROMIUM

from .gcode_sample import layered_job
from .sample import block_surface, deviation_surface, planar_network, sample_data

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--disable-background-networking", "--no-first-run",
    "--disable-component-update", "--virtual-time-budget=8000", "--enable-logging=stderr",
    "--dump-dom",
)  # fmt: skip

NETWORK = ("http:", "https:", "ws:", "wss:")

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium isn't installed")


def opened(path: Path, *flags: str) -> tuple[str, list[str], list[str]]:
    """The page's final DOM, what it wrote on the console, and the addresses it asked for."""
    log = path.with_suffix(".netlog.json")
    profile = f"--user-data-dir={path.parent / 'profile'}"
    command = [str(CHROMIUM), *FLAGS, *flags, profile, f"--log-net-log={log}", path.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    console = [line for line in done.stderr.splitlines() if ":CONSOLE" in line]
    # Swiftshader remarks on its own speed through the console.
    console = [line for line in console if "GL Driver Message" not in line]
    events = json.loads(log.read_text(encoding="utf-8"))["events"]
    # The browser's own errands (its clock, its dictionaries) have no page as their initiator.
    asked = [e["params"] for e in events if "initiator" in e.get("params", {})]
    urls = [str(a["url"]) for a in asked if a["initiator"] != "not an origin" and "url" in a]
    return done.stdout, console, [url for url in urls if url.startswith(NETWORK)]


def state(dom: str, element: str) -> str:
    found = re.search(rf'<{element}[^>]*data-state="(\w+)"', dom)
    return found.group(1) if found else ""


def write_sample(path: Path) -> None:
    data = sample_data()
    data["recipe"] = "</script><script>document.title='taken'</script>"
    job = layered_job()
    layer = layer_figure(job, 0, colourings(job)[0])
    surfaces = [deviation_surface(0.4), block_surface()]
    write_report_html(path, data, surfaces, planar_network(), {"toolpath/Layer": layer})


def test_page_starts_without_errors_and_asks_for_nothing(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_sample(path)
    dom, console, urls = opened(path)
    assert console == []
    assert state(dom, "html") == "ready"
    assert state(dom, 'div class="viewer"') == "ready"
    assert "<canvas" in dom
    assert "<title>taken" not in dom
    assert urls == []


def test_a_page_that_does_ask_would_be_noticed(tmp_path: Path) -> None:
    path = tmp_path / "asking.html"
    path.write_text('<img src="http://127.0.0.1:9/a.png"><script>x.y()</script>', encoding="utf-8")
    _, console, urls = opened(path)
    assert urls
    assert any("ReferenceError" in line for line in console)


@pytest.mark.parametrize(("write", "below"), [("report", True), ("network", False)])
def test_without_webgl_the_page_says_so_and_the_rest_works(
    tmp_path: Path, write: str, below: bool
) -> None:
    path = tmp_path / "page.html"
    (write_sample if write == "report" else write_network)(path)
    look = "const p = document.querySelector('.message'); document.body.dataset.seen = "
    dom = acted(path, f"{look}[getComputedStyle(p).display, p.textContent];", "--disable-3d-apis")
    assert state(dom, 'div class="viewer"') == "failed"
    assert state(dom, "html") == "ready"
    assert 'data-seen="grid,The 3D view needs JavaScript and WebGL' in dom
    assert ("tables below" in dom) is below


def acted(path: Path, script: str, *flags: str) -> str:
    """The DOM after ``script`` ran beside the page's own, whose policy would forbid it."""
    text = path.read_text(encoding="utf-8")
    text = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", text)
    act = (
        "const wait = (ms) => new Promise((done) => setTimeout(done, ms));"
        "while (document.documentElement.dataset.state !== 'ready') await wait(50);"
        "const box = document.querySelector('#stage canvas')?.getBoundingClientRect();"
        "const point = (name, x, y, more = {}) => document.querySelector('#stage canvas')"
        ".dispatchEvent(new PointerEvent(name, { clientX: box.left + x * box.width,"
        " clientY: box.top + y * box.height, bubbles: true, pointerId: 1, ...more }));"
        "const change = (id, value, name = 'change') => { const e = document.getElementById(id);"
        " e.value = value; e.dispatchEvent(new Event(name)); };"
    )
    path.write_text(text.replace("</body>", f'<script type="module">{act}{script}</script></body>'))
    return opened(path, *flags)[0]


def test_a_lost_context_is_said_and_drawn_again_when_it_is_back(tmp_path: Path) -> None:
    path = tmp_path / "network.html"
    write_network(path)
    dom = acted(
        path,
        "const canvas = document.querySelector('#stage canvas'); const seen = [];"
        "const shown = () => seen.push(document.querySelector('.view-lost').hidden);"
        "const hold = canvas.getContext('webgl2').getExtension('WEBGL_lose_context');"
        "shown(); hold.loseContext(); await wait(100); shown();"
        "hold.restoreContext(); await wait(300); shown();"
        "window.dispatchEvent(new Event('beforeprint'));"
        "seen.push(document.getElementById('print-picture').src.length > 5000);"
        "document.body.dataset.seen = seen;",
    )
    assert 'data-seen="true,false,true,true"' in dom


def test_legends_tell_a_constant_and_what_lies_beyond_their_ends(tmp_path: Path) -> None:
    path = tmp_path / "network.html"
    network = planar_network()
    network = replace(network, radius=np.full_like(network.radius, 0.5))
    error = np.zeros(network.vessel_count)
    error[:2] = -90.0, 1.0
    shown = quantities(network, VesselQuantities(gauged={"error_percent": error}))
    write_network_html(path, network, shown, [], NetworkPage("planar"))
    assert inner(opened(path)[0], "legends").split() == ["Radius", "/", "mm", "0.5"]
    write_network_html(path, network, shown, [], NetworkPage("planar", "deviation"))
    dom = opened(path)[0]
    assert ">≤ −" in dom
    assert ">≥ " not in dom
    assert "Values from −90 to +1" in dom


def write_network(path: Path, first: str = "radius") -> None:
    network = planar_network()
    known = VesselQuantities(flow={"flow_ml_min": np.linspace(0.01, 0.25, network.vessel_count)})
    page = NetworkPage("planar", first, ("A note.",))
    write_network_html(path, network, quantities(network, known), [block_surface()], page)


def inner(dom: str, element: str) -> str:
    found = re.search(rf'<\w+[^>]*id="{element}"[^>]*>(.*?)</(?:div|select)>', dom, re.S)
    return re.sub(r"<[^>]+>", " ", found.group(1)) if found else ""


def test_network_page_starts_without_errors_and_asks_for_nothing(tmp_path: Path) -> None:
    path = tmp_path / "network.html"
    write_network(path, "flow")
    dom, console, urls = opened(path)
    assert console == []
    assert urls == []
    assert state(dom, 'div class="viewer"') == "ready"
    assert "Flow / mL/min" in inner(dom, "legends")
    assert "A note." in dom


@pytest.mark.slow
def test_pointing_at_a_vessel_tells_its_numbers_and_cutting_it_away_hides_it(tmp_path):
    path = tmp_path / "network.html"
    write_network(path)
    # From above the block's middle lies between the second and third channel; the third (y = 5.0,
    # diameter 0.6 mm) is vessel 7.
    look = (
        "[...document.querySelectorAll('#directions button')].find((b) => b.textContent === 'Top')"
        ".click(); await wait(300);"
        "const scale = box.width / 16 / 1.12; const y = 0.5 - (1.0 * scale) / box.height;"
    )
    pick = "point('pointermove', 0.5, y); await wait(300);"
    click = "point('pointerdown', 0.5, y); point('pointerup', 0.5, y); await wait(300);"
    dom = acted(path, look + pick + click)
    assert "vessel 7" in inner(dom, "probe")
    assert "Diameter 0.6 mm" in inner(dom, "probe")
    assert "Length 10 mm" in inner(dom, "probe")
    selection = inner(dom, "selection")
    assert "Vessel 7" in dom
    assert "Kind of vessel" in dom
    assert selection
    write_network(path)
    dom = acted(path, look + "change('clip-axis', 'z'); change('clip', 100, 'input');" + pick)
    assert inner(dom, "probe").strip() == ""
