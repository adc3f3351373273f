import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from registration.report import layer_figure, write_report_html

from .sample import block_surface, deviation_surface, planar_network, sample_data

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
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
    layer = layer_figure([np.array([[0, 0], [5, 0]])], (), 0.15)
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


def test_without_webgl_the_rest_of_the_page_still_works(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_sample(path)
    dom, _, _ = opened(path, "--disable-3d-apis")
    assert state(dom, 'div class="viewer"') == "failed"
    assert state(dom, "html") == "ready"
