import contextlib
import os
import socket
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.browser

# NiceGUI is one application a process, so that this page gets a process of its own.
PAGE = """
import socket, sys
from pathlib import Path
from nicegui import app, ui
from printctl.web.live.routes import live_view, preload
from printctl.web.live.routes import SceneMaker
from printctl.web.live.routes import router
from tests.printctl.web.live import jobs

folder = Path(sys.argv[1])
source = jobs.source(folder, jobs.squares(6))
maker = SceneMaker()
app.include_router(router({"a b": source}.__getitem__, maker))
app.on_startup(maker.start)
app.on_shutdown(maker.close)

@ui.page("/")
def page() -> None:
    ui.add_head_html(preload("a b"))
    with ui.column().style("width: 800px; height: 600px"):
        view = live_view("a b", live=True)
    told = {"lines_executed": 30, "lines_done": 33, "position": [1, 2, 3]}
    ui.button("tell", on_click=lambda: view.tell(told))

with socket.socket() as free:
    free.bind(("127.0.0.1", 0))
    port = free.getsockname()[1]
app.on_startup(lambda: print(port, flush=True))
ui.run(host="127.0.0.1", port=port, reload=False, show=False, show_welcome_message=False)
"""


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    script = tmp_path / "page.py"
    script.write_text(textwrap.dedent(PAGE))
    # Under pytest NiceGUI would run as its own tests do.
    env = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
    command = [sys.executable, str(script), str(tmp_path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=env)
    assert process.stdout is not None
    port = process.stdout.readline().strip()
    assert port.isdigit()
    for _ in range(200):  # it is printed before the server listens
        with contextlib.suppress(OSError):
            socket.create_connection(("127.0.0.1", int(port)), 1).close()
            break
        time.sleep(0.05)
    yield f"http://127.0.0.1:{port}"
    process.terminate()
    process.wait(20)
    process.stdout.close()


@pytest.mark.slow
def test_a_page_of_nicegui_shows_the_view_and_tells_it(address: str, browser: Any) -> None:
    problems: list[str] = []
    asked: list[str] = []
    page = browser.new_page()
    page.on("pageerror", lambda problem: problems.append(str(problem)))
    page.on("console", lambda said: problems.append(said.text) if said.type != "log" else None)
    page.on("request", lambda request: asked.extend(request.url.split("/live/")[1:]))
    page.goto(address)
    page.wait_for_selector("[data-drawn]")
    assert "0 of 88" in page.locator(".live-words").inner_text()
    page.get_by_role("button", name="tell").click()
    page.wait_for_selector("text=30 of 88 commands executed")
    assert page.locator(".live-tip").is_visible()
    page.wait_for_timeout(4000)  # after 3 s a browser says what was fetched for nothing
    # Waiting for a frame to be put together is the software's drawing, not a problem.
    assert not [said for said in problems if "GPU stall" not in said]
    assert sorted(set(asked)) == sorted(asked), "something was asked for twice"
    assert {"a%20b/scene", "static/gl_painter.js"} <= set(asked)
