"""Pages in Chromium: they start, follow keys and pointer, ask for nothing."""

import json
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from report import NetworkPage, write_network_html, write_report_html
from report.gcode import GcodePage, design_outline, layer_figure, write_gcode_html
from report.gcode.colouring import colourings
from report.picture import VesselQuantities, quantities
from report.play import write_play_html
from report.views import SectionStack, Views
from report.views.stack import PIXELS
from tests.printctl.web.shell.browsers import CHROMIUM

from .gcode_sample import layered_job
from .play_sample import layered, passes
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


@pytest.mark.parametrize("write", ["report", "network"])
def test_without_webgl_a_plain_picture_is_drawn_and_the_rest_works(
    tmp_path: Path, write: str
) -> None:
    path = tmp_path / "page.html"
    (write_sample if write == "report" else write_network)(path)
    script = (
        "const stage = document.getElementById('stage');"
        "const hues = () => { const c = stage.querySelector('canvas');"
        " const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;"
        " const seen = new Set(); for (let i = 0; i < d.length; i += 4) if (d[i + 3] === 255)"
        " seen.add(`${d[i]} ${d[i + 1]} ${d[i + 2]}`); return seen.size; };"
        "const picture = () => stage.querySelector('canvas').toDataURL();"
        "await wait(300); say(`hues ${hues() > 3}`); const before = picture();"
        "[...document.querySelectorAll('#directions button')].find((b) => b.textContent === 'Top')"
        ".click(); await wait(300); say(`turned ${picture() !== before}`);"
        "say(document.getElementById('panel').textContent.includes('no WebGL'));"
    )
    dom, seen = acted(path, script, "--disable-3d-apis")
    assert state(dom, 'div class="viewer"') == "ready"
    assert state(dom, "html") == "ready"
    assert seen == ["hues true", "turned true", "true"]


READY = (
    "const wait = (ms) => new Promise((done) => setTimeout(done, ms));"
    "while (document.documentElement.dataset.state !== 'ready') await wait(50);"
    "const say = (text) => { document.title += `|${text}`; };"
)
POINT = (
    "const box = document.querySelector('#stage canvas').getBoundingClientRect();"
    "const point = (name, x, y, more = {}) => document.querySelector('#stage canvas')"
    ".dispatchEvent(new PointerEvent(name, { clientX: box.left + x * box.width,"
    " clientY: box.top + y * box.height, bubbles: true, pointerId: 1, ...more }));"
    "const change = (id, value, name = 'change') => { const e = document.getElementById(id);"
    " e.value = value; e.dispatchEvent(new Event(name)); };"
)
KEYS = (
    "const key = (name, more = {}) => stage.dispatchEvent(new KeyboardEvent('keydown',"
    " { key: name, bubbles: true, ...more }));"
    "const counted = (seen) => { const c = stage.querySelector('canvas');"
    " const copy = new OffscreenCanvas(c.width, c.height).getContext('2d',"
    " { willReadFrequently: true }); copy.drawImage(c, 0, 0);"
    " const d = copy.getImageData(0, 0, c.width, c.height).data;"
    " let n = 0; for (let i = 0; i < d.length; i += 4) n += seen(d[i], d[i + 2], d[i + 3]);"
    " return n; };"
)
"""``counted``: pixels of the stage whose red, blue, alpha are such."""


def acted(path: Path, script: str, *flags: str) -> tuple[str, list[str]]:
    """The DOM after ``script`` ran beside the page's own, whose policy forbids it; what it said."""
    text = path.read_text(encoding="utf-8")
    text = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", text)
    added = f'<script type="module">{READY}{script} await wait(300);</script></body>'
    path.write_text(text.replace("</body>", added), encoding="utf-8")
    dom, console, urls = opened(path, *flags)
    assert flags or [line for line in console if "WebGLRenderer: Context" not in line] == []
    assert urls == []
    return dom, re.search(r"<title>(.*?)</title>", dom, re.S).group(1).strip().split("|")[1:]


def test_a_lost_context_is_said_and_drawn_again_when_it_is_back(tmp_path: Path) -> None:
    path = tmp_path / "network.html"
    write_network(path)
    dom, _ = acted(
        path,
        "const canvas = document.querySelector('#stage canvas'); const seen = [];"
        "const shown = () => seen.push(document.querySelector('.view-lost').hidden);"
        "const hold = canvas.getContext('webgl2').getExtension('WEBGL_lose_context');"
        "shown(); hold.loseContext(); await wait(100); shown();"
        "const lost = document.querySelector('.view-lost');"
        "const printed = () => seen.push(lost.offsetHeight > 20, canvas.offsetHeight > 0,"
        " document.getElementById('print-picture').offsetHeight > 20);"
        "const printing = [...document.styleSheets].flatMap((sheet) => [...sheet.cssRules])"
        ".filter((rule) => rule.media?.mediaText === 'print');"
        "const on = (media) => { for (const rule of printing) rule.media.mediaText = media; };"
        "window.dispatchEvent(new Event('beforeprint')); on('screen'); printed(); on('print');"
        "hold.restoreContext(); await wait(300); shown();"
        "window.dispatchEvent(new Event('beforeprint'));"
        "seen.push(document.getElementById('print-picture').src.length > 5000);"
        "on('screen'); await wait(100); printed();"
        "document.body.dataset.seen = seen;",
    )
    assert 'data-seen="true,false,true,false,false,true,true,false,false,true"' in dom


def test_legends_tell_a_constant_and_what_lies_beyond_their_ends(tmp_path: Path) -> None:
    path = tmp_path / "network.html"
    network = planar_network()
    network = replace(network, radius=np.full_like(network.radius, 0.5))
    nearly = replace(network, radius=0.5 + 1e-6 * np.arange(len(network.radius)))
    write_network_html(tmp_path / "nearly.html", nearly, quantities(nearly), [], NetworkPage("n"))
    ticks = re.search(r'class="ticks">(.*?)</div>', opened(tmp_path / "nearly.html")[0])[1]
    first, last = re.findall(r">([^<]+)<", ticks)
    assert first == "0.5"
    assert last.startswith("0.5000")
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
    dom, _ = acted(path, POINT + look + pick + click)
    assert "vessel 7" in inner(dom, "probe")
    assert "Diameter 0.6 mm" in inner(dom, "probe")
    assert "Length 10 mm" in inner(dom, "probe")
    selection = inner(dom, "selection")
    assert "Vessel 7" in dom
    assert "Kind of vessel" in dom
    assert selection
    write_network(path)
    dom, _ = acted(
        path, POINT + look + "change('clip-axis', 'z'); change('clip', 100, 'input');" + pick
    )
    assert inner(dom, "probe").strip() == ""


def job_page(folder: Path, script: str = "", layer: int = 0, outlines=None):
    """The DOM of a job's page after ``script`` ran beside its own, and what it said."""
    write_gcode_html(folder / "job.html", layered_job(), GcodePage("width", layer), outlines)
    stage = "await wait(200); const stage = document.getElementById('stage');"
    return acted(folder / "job.html", stage + KEYS + script)


def inner(dom: str, element: str) -> str:
    found = re.search(rf'<(\w+)[^>]*id="{element}"[^>]*>(.*?)</\1>', dom, re.S)
    return re.sub(r"<[^>]+>", " ", found.group(2)).strip() if found else ""


def test_the_designs_outline_is_drawn_and_can_be_hidden(tmp_path: Path) -> None:
    job = layered_job()
    low, high = job.end[:, :2].min(axis=0), job.end[:, :2].max(axis=0)
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    outlines = [design_outline(job, k, [corners]) for k in range(2)]
    # Orange and blue are on the canvas as long as the outline is shown.
    script = (
        "const coloured = () => counted((r, b, a) => a > 200 && Math.abs(r - b) > 60);"
        "for (const id of ['show-travels', 'show-dots']) {"
        " document.getElementById(id).click(); } await wait(200); say(coloured());"
        "document.getElementById('show-outline').click(); await wait(200); say(coloured());"
        "document.getElementById('show-outline').click(); await wait(200);"
    )
    dom, said = job_page(tmp_path, script, 1, outlines)
    shown, hidden = map(int, said)
    assert shown > 100 > hidden
    assert "Past outline" in inner(dom, "numbers")
    assert "beyond the design" in inner(dom, "legend")


def test_page_starts_without_errors_and_tells_the_layers_numbers(tmp_path: Path) -> None:
    dom, _ = job_page(tmp_path, layer=1)
    assert state(dom, "html") == "ready"
    assert state(dom, 'div class="viewer"') == "ready"
    numbers = re.sub(r"\s+", " ", inner(dom, "numbers"))
    assert "Tip at z 0.12 mm" in numbers
    assert "Written 1 µL" in numbers
    assert "Way written 20 mm" in numbers
    assert "Time as fed 1.5 s" in numbers
    assert "Lines of the file 15–20" in numbers
    assert "Line width / mm" in inner(dom, "legend")
    assert "A note." in dom


def test_keys_go_through_layers_and_moves(tmp_path: Path) -> None:
    keys = (
        "key('ArrowUp'); await wait(300); say(document.getElementById('layer-tag').textContent);"
        "key('ArrowUp'); await wait(300); say(document.getElementById('layer-tag').textContent);"
        "key('ArrowDown'); await wait(300); say(document.getElementById('layer-tag').textContent);"
        "const inked = () => counted((r, b, a) => a > 100); const whole = inked();"
        "key('ArrowLeft'); await wait(300); key('ArrowLeft');"
        "await wait(300); say(document.getElementById('move').value); say(inked() < whole);"
    )
    assert job_page(tmp_path, keys)[1] == ["layer 2", "layer 2", "layer 1", "2", "true"]


def test_a_layer_that_is_typed_is_rounded_and_kept_within_the_job(tmp_path: Path) -> None:
    script = POINT + "".join(
        f"change('number', '{typed}', 'input'); await wait(150); change('number', '{typed}');"
        "say(['number', 'layer'].map((id) => document.getElementById(id).value).join('/'));"
        for typed in ("1.3", "2.7", "-4")
    )
    dom, said = job_page(tmp_path, script)
    assert said == ["1/1", "2/2", "1/1"]
    assert "2 layers" in dom


def played(folder: Path, job, script: str) -> tuple[str, list[str]]:
    """The DOM of a playback's page after ``script`` ran beside its own, and what it said."""
    write_play_html(folder / "play.html", job, "job")
    own = (
        "const at = (id) => document.getElementById(`play-${id}`); const stage = at('stage');"
        "const now = async () => { await wait(200); say(at('clock').textContent.split(' ')[0]); };"
    )
    dom, said = acted(folder / "play.html", own + KEYS + script)
    assert state(dom, 'div class="viewer play"') == "ready"
    return dom, said


def test_address_keys_marks_and_list_go_through_the_time(tmp_path: Path) -> None:
    script = (
        "const hue = () => counted((r, b) => b > r + 40);"
        "await now(); const all = hue(); location.hash = '#t=0.5'; await now();"
        "say(at('tag').textContent); const half = hue();"
        "say(half < all && all > 0);"
        "key('ArrowDown'); await now(); key('ArrowUp'); await now();"
        "key('ArrowLeft', { shiftKey: true }); await now(); key('Home'); await now();"
        "document.querySelector('.go').click(); await now();"
        "key('Home'); document.querySelector('.mark').click(); await now();"
        "key(' '); await wait(600); key(' ');"
        "say(Number(at('time').value) > 7); say(at('play').textContent);"
    )
    dom, said = played(tmp_path, layered(), script)
    # Layer 1 ends at 3 s, layer 2 begins at 5 s and ends at 9 s, its last stretch begins at 8 s.
    assert said == ["0:09.0", "0:04.5", "Layer 2 of 2", "true", "0:03.0", "0:09.0", "0:08.0",
                    "0:00.0", "0:07.0", "0:07.0", "true", "▶"]  # fmt: skip
    assert "much too thin" in dom


def test_numbers_and_colours_follow_the_moment(tmp_path: Path) -> None:
    script = (
        "location.hash = '#t=0.9&colour=head'; await now(); say(at('colouring').value);"
        "say(at('legend').querySelectorAll('.swatches:first-of-type i').length > 0);"
    )
    dom, said = played(tmp_path, passes(), script)
    assert said == ["0:04.5", "head", "true"]
    numbers = re.search(r'id="play-numbers">(.*?)</dl>', dom, re.S).group(1)
    told = dict(re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", numbers))
    assert told["Pass"].startswith("3,")
    assert told["Width"] == "0.200 mm, −20.0\u202f%"
    # Half of the last stretch, from (0, 5, 6) to (2, 2, 4).
    assert (told["Needle x, y"], told["Needle z"]) == ("1.000, 3.500", "5.000 mm")
    assert told["Ink laid"] == "1.25 of 1.5 µL"
    assert (told["Vessel"], told["The needle"]) == ("6", "writes")
    assert told["Ink"].startswith("&lt;/script&gt;")


COUNT = 10


def two_vessels() -> dict[str, object]:
    """Two vessels of ten sections, the second with a stenosis that fails."""
    rows = []
    for vessel in (0, 1):
        diameter = np.full(COUNT, 500.0)
        diameter[3] -= 200.0 * vessel
        rows.append({
            "vessel": vessel, "kind": "channel", "designed_um": 500.0, "length_mm": 5.0,
            "measured_um": 490.0, "error_percent": -2.0, "open": True,
            "along_mm": [0.25 + 0.5 * k for k in range(COUNT)], "diameter_um": diameter.tolist(),
            "interval_95_um": [12.0] * COUNT, "designed_along_um": [500.0] * COUNT,
            "lower_um": [450.0] * COUNT, "upper_um": [550.0] * COUNT,
            "offset_along_um": [3.0] * COUNT, "ovality_along": [1.02] * COUNT,
            "decision_along": ["fail" if d < 450 else "pass" for d in diameter],
        })  # fmt: skip
    return {"vessels": rows, "findings": [], "judging": {"rule": "a rule", "tolerances": {}}}


def views(left_out: int = 0) -> Views:
    """Pictures of their sections; the last `left_out` have none."""
    n = 2 * COUNT - left_out
    angle = 2 * np.pi * np.arange(48) / 48
    circle = 0.25 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return Views(
        SectionStack(
            np.repeat([0, 1], COUNT)[:n], np.tile(np.arange(COUNT), 2)[:n], np.full(n, 0.25),
            np.full(n, 0.55), np.full((n, PIXELS, PIXELS), 128, np.uint8),
            np.tile(circle, (n, 1, 1)), 2 * COUNT,
        ), (), 0, True, True,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason="chromium isn't installed")
def test_a_click_on_a_vessels_drawing_shows_the_section_under_it(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    data = sample_data() | {"registration": two_vessels()}
    write_report_html(path, data, [block_surface()], planar_network(), views=views(left_out=1))
    shown = facts(acted(path, "")[0])
    # The page begins with what fails.
    assert shown["Vessel, section"] == "1, 4 of 10"
    assert shown["Measured"] == "300.0 µm ± 12.0 µm (95 %)"
    click = (
        "const frame = document.querySelector(\"svg g[id*='along-0-']\");"
        "const at = frame.getBoundingClientRect();"
        "frame.ownerSVGElement.dispatchEvent(new MouseEvent('click', { bubbles: true,"
        " clientX: at.left + 0.76 * at.width, clientY: at.top + at.height / 2 }));"
    )
    write_report_html(path, data, [block_surface()], planar_network(), views=views(left_out=1))
    shown = facts(acted(path, click)[0])
    assert shown["Vessel, section"] == "0, 8 of 10"
    assert shown["Along"] == "3.75 mm"


def facts(dom: str) -> dict[str, str]:
    """Labels and values of the viewer."""
    box = re.search(r'<div class="sections" id="sections">(.*?)</dl>', dom, re.DOTALL)
    assert box is not None, "the viewer isn't shown"
    return dict(re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", box.group(1)))
