import re
from pathlib import Path

import numpy as np

from registration.report.gcode import GcodePage, design_outline, write_gcode_html

from .gcode_sample import layered_job
from .test_browser import opened, pytestmark, state  # noqa: F401

ACT = (
    "const wait = (ms) => new Promise((done) => setTimeout(done, ms));"
    "while (document.documentElement.dataset.state !== 'ready') await wait(50);"
    "await wait(200); const stage = document.getElementById('stage');"
    "const box = stage.getBoundingClientRect();"
    "const point = (name, x, y, more = {}) => stage.dispatchEvent(new PointerEvent(name,"
    " { clientX: box.left + x * box.width, clientY: box.top + y * box.height, bubbles: true,"
    " pointerId: 1, ...more }));"
    "const key = (name, more = {}) => stage.dispatchEvent(new KeyboardEvent('keydown',"
    " { key: name, bubbles: true, ...more }));"
    "const set = (id, value, name = 'input') => { const e = document.getElementById(id);"
    " e.value = value; e.dispatchEvent(new Event(name)); };"
    "const inked = () => { const c = stage.querySelector('canvas');"
    " const copy = new OffscreenCanvas(c.width, c.height).getContext('2d',"
    " { willReadFrequently: true }); copy.drawImage(c, 0, 0);"
    " return copy.getImageData(0, 0, c.width, c.height).data"
    ".filter((value, i) => i % 4 === 3 && value > 100).length; };"
    "const say = (text) => { document.title += ` ${text}`; };"
)


def page(folder: Path, job, colour: str, script: str = "", layer: int = 0, outlines=None) -> str:
    """The DOM of a job's page after ``script`` ran beside its own."""
    path = folder / "job.html"
    write_gcode_html(path, job, GcodePage(colour, layer), outlines)
    if script:
        text = path.read_text(encoding="utf-8")
        text = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", text)
        added = f'<script type="module">{ACT}{script} await wait(300);</script></body>'
        path.write_text(text.replace("</body>", added), encoding="utf-8")
    dom, console, urls = opened(path)
    assert console == []
    assert urls == []
    return dom


def inner(dom: str, element: str) -> str:
    found = re.search(rf'<(\w+)[^>]*id="{element}"[^>]*>(.*?)</\1>', dom, re.S)
    return re.sub(r"<[^>]+>", " ", found.group(2)).strip() if found else ""


def title(dom: str) -> list[str]:
    return re.search(r"<title>(.*?)</title>", dom, re.S).group(1).split()[3:]


def test_the_designs_outline_is_drawn_and_can_be_hidden(tmp_path: Path) -> None:
    job = layered_job()
    low, high = job.end[:, :2].min(axis=0), job.end[:, :2].max(axis=0)
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    outlines = [design_outline(job, k, [corners]) for k in range(2)]
    # Orange and blue are on the canvas as long as the outline is shown.
    script = (
        "const coloured = () => { const c = stage.querySelector('canvas');"
        " const copy = new OffscreenCanvas(c.width, c.height).getContext('2d');"
        " copy.drawImage(c, 0, 0); const d = copy.getImageData(0, 0, c.width, c.height).data;"
        " let n = 0; for (let i = 0; i < d.length; i += 4)"
        " n += d[i + 3] > 200 && Math.abs(d[i] - d[i + 2]) > 60; return n; };"
        "for (const id of ['show-travels', 'show-dots']) {"
        " document.getElementById(id).click(); } await wait(200); say(coloured());"
        "document.getElementById('show-outline').click(); await wait(200); say(coloured());"
        "document.getElementById('show-outline').click(); await wait(200);"
    )
    dom = page(tmp_path, job, "line", script, 1, outlines)
    shown, hidden = map(int, title(dom))
    assert shown > 100 > hidden
    assert "Past outline" in inner(dom, "numbers")
    assert "beyond the design" in inner(dom, "legend")


def test_page_starts_without_errors_and_tells_the_layers_numbers(tmp_path: Path) -> None:
    dom = page(tmp_path, layered_job(), "width", layer=1)
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
        "const whole = inked(); key('ArrowLeft'); await wait(300); key('ArrowLeft');"
        "await wait(300); say(document.getElementById('move').value); say(inked() < whole);"
    )
    dom = page(tmp_path, layered_job(), "width", keys)
    assert title(dom) == ["layer", "2", "layer", "2", "layer", "1", "2", "true"]


def test_a_layer_that_is_typed_is_rounded_and_kept_within_the_job(tmp_path: Path) -> None:
    script = "".join(
        f"set('number', '{typed}'); await wait(150); set('number', '{typed}', 'change');"
        "say(['number', 'layer'].map((id) => document.getElementById(id).value).join('/'));"
        for typed in ("1.3", "2.7", "-4")
    )
    dom = page(tmp_path, layered_job(), "width", script)
    assert title(dom) == ["1/1", "2/2", "1/1"]
    assert "2 layers" in dom
