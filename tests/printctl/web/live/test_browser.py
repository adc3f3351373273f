"""Live view in a real browser (`make test-browser`)."""

from __future__ import annotations

import io
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import uvicorn
from PIL import Image

from tests.printctl.web.live import jobs
from tests.printctl.web.live.page import application
from tests.printctl.web.shell.browsers import serious
from tests.slower import first_of

NASTY = jobs.HEAD + b";<img src=x onerror=alert(1)>\nG1 X5 F600\n"

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Where a page with the view is served."""
    known = {"squares": jobs.squares(12, 5), "nasty": NASTY}
    sources = {
        name: jobs.source(tmp_path_factory.mktemp(name), data) for name, data in known.items()
    }
    config = uvicorn.Config(application(sources), port=0, log_level="error", ws="none")
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        thread.join(0.05)
        assert thread.is_alive()
    port = server.servers[0].sockets[0].getsockname()[1]
    yield f"http://127.0.0.1:{port}"
    server.should_exit = True
    thread.join(10)


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    context = browser.new_context(viewport={"width": 900, "height": 700})
    found = context.new_page()
    problems: list[str] = []
    found.on("pageerror", lambda problem: problems.append(str(problem)))
    yield found
    context.close()
    assert not problems


def opened(page: Any, url: str) -> Any:
    page.goto(url)
    page.wait_for_selector("[data-drawn]")
    return page


def picture(page: Any) -> np.ndarray[Any, Any]:
    """The stage as it is seen, (h, w, 3), without the ring that shows the focus."""
    shot = page.locator(".live-stage").screenshot()
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB")).astype(int)[6:-6, 6:-6]


def coloured(image: np.ndarray[Any, Any]) -> float:
    """Share of the picture in strong colours, as only what is written or comes next has them."""
    return float((image.max(axis=2) - image.min(axis=2) > 40).mean())


def executed(page: Any, commands: int) -> None:
    page.evaluate("n => view.update({ executed: n, acknowledged: n, position: null })", commands)
    page.wait_for_function("n => view.last.words > 0 && view.status.executed === n", arg=commands)
    page.wait_for_timeout(1500)


@pytest.mark.parametrize("plain", first_of(["false", "true"]))
def test_a_job_as_planned_is_seen_at_once(page: Any, address: str, plain: str) -> None:
    opened(page, f"{address}/job/squares?plain={plain}")
    assert page.evaluate("view.flat") == (plain == "true")
    assert coloured(picture(page)) > 0.05


@pytest.mark.parametrize("plain", first_of(["false", "true"]))
def test_only_what_was_executed_is_drawn_as_written(page: Any, address: str, plain: str) -> None:
    opened(page, f"{address}/job/squares?live=true&plain={plain}")
    page.evaluate("view.options.ahead = 0")
    page.evaluate("view.needle.svg.remove()")
    page.evaluate("view.choose({ layers: [0, 0] })")
    shares = []
    for commands in (4, 14, 27):
        executed(page, commands)
        shares.append(coloured(picture(page)))
    assert shares[0] < 0.005
    assert shares[0] + 0.002 < shares[1]
    assert shares[1] + 0.002 < shares[2]


def test_updates_draw_the_new_moves_alone(page: Any, address: str) -> None:
    opened(page, f"{address}/job/squares?live=true")
    executed(page, 20)
    drawn = page.evaluate("view.root.dataset.drawn")
    executed(page, 60)
    assert page.evaluate("view.painter.painted.written") == page.evaluate("view.state.written")
    assert page.evaluate("view.root.dataset.drawn") == drawn


def test_the_slider_hides_layers(page: Any, address: str) -> None:
    opened(page, f"{address}/job/squares")
    everything = coloured(picture(page))
    page.get_by_label("Last layer shown").fill("2")
    page.wait_for_timeout(800)
    assert coloured(picture(page)) < 0.8 * everything
    assert "layers 1 to 2 of 12" in page.locator(".live-range").inner_text()


def test_a_job_that_cannot_be_shown_says_why_as_text(page: Any, address: str) -> None:
    page.goto(f"{address}/job/nasty")
    page.wait_for_selector(".live-problem")
    assert "writes" in page.locator(".live-problem").inner_text()
    assert page.locator(".live-view img").count() == 0


def test_without_serious_findings_of_axe(page: Any, address: str) -> None:
    opened(page, f"{address}/job/squares?live=true")
    assert serious(page) == []


MEND = {"look": 3, "written": True, "strokes": [[[2, 2, 0.2], [8, 2, 0.2], [8, 6, 0.2]]]}


@pytest.mark.parametrize("plain", first_of(["false", "true"]))
def test_mends_are_drawn_where_they_lie_and_unlike_the_job(
    page: Any, address: str, plain: str
) -> None:
    opened(page, f"{address}/job/squares?live=true&plain={plain}")
    executed(page, 20)
    before = picture(page)
    page.evaluate("m => view.update({ mends: [m, { ...m, look: 4, written: false }] })", MEND)
    page.wait_for_function("document.querySelectorAll('.live-mend').length === 2")
    page.evaluate("view.choose({})")
    page.wait_for_timeout(1000)
    assert page.locator(".live-mend-ahead").count() == 1
    assert "1 mend written (violet)" in page.locator(".live-words").first.inner_text()
    drawn = page.evaluate("document.querySelector('.live-mend').getAttribute('points')").split()
    for place, said in zip(MEND["strokes"][0], drawn, strict=True):
        seen = page.evaluate("at => view.painter.project(at)", place)
        assert [float(px) for px in said.split(",")] == pytest.approx(seen, abs=0.1)
    after = picture(page)

    def violet(image: np.ndarray[Any, Any]) -> int:
        red, green, blue = (image[..., k] for k in range(3))
        return int(((red > 110) & (green < 70) & (blue > 130)).sum())

    assert violet(before) == 0
    assert violet(after) > 50


def test_a_lost_context_is_said_and_the_view_comes_back_as_it_was(page: Any, address: str) -> None:
    opened(page, f"{address}/job/squares")
    page.wait_for_timeout(1000)
    before = picture(page)
    page.evaluate(
        "window.held = view.painter.renderer.getContext().getExtension('WEBGL_lose_context')"
    )
    page.evaluate("held.loseContext()")
    page.wait_for_selector(".view-lost:not([hidden])")
    page.evaluate("held.restoreContext()")
    page.wait_for_selector(".view-lost", state="hidden")
    page.wait_for_timeout(2000)
    assert np.abs(picture(page) - before).mean() < 1
