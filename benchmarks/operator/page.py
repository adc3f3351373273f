"""The page as a stranger meets it: what is seen without scrolling, ways and waits.

One way from the open page to the report of a rehearsed print, counted in clicks; heights of the
page before, during and after a print; a slider's way to the tree that is grown anew; first paints.
In a headless Chromium, the server in a process of its own.
"""

from __future__ import annotations

import math
import re
import statistics
import time
from collections.abc import Iterator
from typing import Any

from benchmarks.common import Row, all_of, limited
from benchmarks.operator.server import browsers, chromium_path, page_server, until, workspace

DESKTOP, TABLET, PHONE = (1280, 800), (1024, 768), (400, 800)
SIZES = {"desktop": DESKTOP, "tablet": TABLET, "phone": PHONE}
TILES = ("Time left", "Pass", "Ink", "Temperatures", "Tip", "Alarms")
HIGHEST = {"desktop": 1000, "phone": 2000}
_LONG_MS = 300_000
_EXAMPLE, _JOB = "A small tree", "/job?job=run~planar_tree"
# A text is one that is typed into a field: not a slider, a tick, a choice or a file.
_COUNT_TEXTS = """addEventListener("input", ({ target }) => {
  if (!target.matches("textarea, input:not([type=range], [type=checkbox], [type=file])")) return;
  sessionStorage.texts = Number(sessionStorage.texts ?? 0) + 1;
}, true);"""
_REGROW = """async (value) => {
  const label = [...document.querySelectorAll("label")].find((one) => one.textContent === "Ends");
  const slider = document.getElementById(label.htmlFor);
  const pen = document.querySelector("canvas").getContext("2d");
  const [clear, ask] = [pen.clearRect.bind(pen), window.fetch];
  let answered = false;
  window.fetch = async (...values) => {
    const answer = await ask(...values);
    answered = String(values[0]).includes("sketch");
    return answer;
  };
  const began = performance.now();
  const painted = new Promise((done) => {
    pen.clearRect = (...values) => {
      clear(...values);
      if (answered) requestAnimationFrame(() => done(performance.now() - began));
    };
  });
  slider.value = value;
  slider.dispatchEvent(new Event("input", { bubbles: true }));
  const took = await painted;
  window.fetch = ask;
  delete pen.clearRect;
  return took;
}"""


def rows(quick: bool) -> Iterator[Row]:
    """Yield what a stranger meets; quick drags the slider 3 times, not 15."""
    chromium_path()
    with workspace() as place, page_server(place) as server, browsers(1) as (page,):
        page.set_viewport_size(dict(zip(("width", "height"), DESKTOP, strict=True)))
        yield limited("first paint of the page, cold", _first_paint(page, server["url"]), "s", 1.0)
        yield from _way(page, server["url"])
        yield from _slider(page, server["url"], 3 if quick else 15)


def _way(page: Any, url: str) -> Iterator[Row]:
    """From the open page to the report, and what is seen beside the rehearsed print."""
    clicks, begin = 0, time.monotonic()
    page.add_init_script(_COUNT_TEXTS)

    def press(name: str) -> None:
        nonlocal clicks
        page.get_by_role("button", name=name, exact=True).click()
        clicks += 1

    page.goto(url)
    press(f"Start from {_EXAMPLE}")
    press("Make it")
    page.get_by_role("heading", name=re.compile("checks let it be printed")).wait_for(
        timeout=_LONG_MS
    )
    yield from _heights(page, f"{url}{_JOB}", "before", back=True)
    press("Next: print or rehearse")
    page.get_by_label("How fast").select_option("1")
    clicks += 2
    press("Rehearse")
    page.get_by_role("link", name="Watch it print").wait_for(timeout=_LONG_MS)
    yield limited(
        "first paint of Job while printing", _first_paint(page, f"{url}{_JOB}.rehearsal"), "s", 0.5
    )
    page.get_by_role("heading", name=re.compile("^Printing ·")).wait_for(timeout=_LONG_MS)
    yield from _seen(page)
    yield from _heights(page, "", "during")
    page.goto(f"{url}/project?name=planar_tree&step=print")
    page.get_by_role("heading", name="The rehearsal is as designed").wait_for(timeout=_LONG_MS)
    took = time.monotonic() - begin
    yield limited("open page to a rehearsed print's report", clicks, "clicks", 10) | {
        "texts": int(page.evaluate("Number(sessionStorage.texts ?? 0)"))
    }
    yield limited("the same, the print in real time (54 s)", round(took, 1), "s", 300.0)
    yield from _heights(page, f"{url}{_JOB}.rehearsal", "after")


def _seen(page: Any) -> Iterator[Row]:
    """Of twelve things, how many lie on the screen whole."""
    for name, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(500)
        bottom = height
        if width < 760:  # there the pages' names are a bar at the bottom
            bottom -= page.get_by_role("navigation", name="Pages").bounding_box()["height"]
        seen = [_lies_within(one, width, bottom) for one in _items(page)]
        yield all_of(f"items seen without scrolling, {name}", sum(seen), len(seen))
    page.set_viewport_size(dict(zip(("width", "height"), DESKTOP, strict=True)))


def _items(page: Any) -> list[Any]:
    region = page.get_by_role("region", name="Print").first
    tiles = region.locator("dl > div")
    return [
        *(tiles.filter(has=page.get_by_text(one, exact=True)).first for one in TILES),
        page.locator("#pc-stop"),
        page.get_by_role("button", name="Pause now"),
        page.get_by_role("button", name="Cancel print"),
        page.get_by_role("heading", name=re.compile("^Printing ·")),
        page.get_by_role("progressbar").first,
        page.get_by_role("application").first,
    ]


def _lies_within(one: Any, width: float, bottom: float) -> bool:
    box = one.bounding_box(timeout=2000) if one.count() else None
    if box is None:
        return False
    right, low = box["x"] + box["width"], box["y"] + box["height"]
    return bool(box["x"] >= 0 and box["y"] >= 0 and right <= width and low <= bottom)


def _heights(page: Any, url: str, when: str, back: bool = False) -> Iterator[Row]:
    """Heights of the Job page; at its address, or where the page stands."""
    was = page.url
    if url:
        page.goto(url)
        page.get_by_role("heading", level=1).wait_for()
        page.wait_for_timeout(2000)
    for name, limit in HIGHEST.items():
        width, height = SIZES[name]
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(500)
        found = page.evaluate("document.documentElement.scrollHeight")
        yield limited(f"height of Job {when} a print, {name}", found, "px", limit)
    page.set_viewport_size(dict(zip(("width", "height"), DESKTOP, strict=True)))
    if back:
        page.goto(was)


def _first_paint(page: Any, url: str) -> float:
    page.goto(url, wait_until="commit")
    until(
        page,
        "performance.getEntriesByName('first-contentful-paint').length"
        " && document.querySelector('#content h1, #content h2')",
    )
    shown = page.evaluate(
        "Math.max(performance.now(),"
        " performance.getEntriesByName('first-contentful-paint')[0].startTime)"
    )
    return round(shown / 1e3, 2)


def _slider(page: Any, url: str, tries: int) -> Iterator[Row]:
    """A folded cortex with about 1,000 ends, regrown at each step of the slider."""
    page.goto(url)
    page.get_by_role("button", name="Start from A folded cortex").click()
    page.get_by_text("grown in").wait_for(timeout=_LONG_MS)
    for label, value in (("Smallest diameter", "0.06"), ("Clearance", "0.02")):
        slider = page.get_by_label(label)
        slider.evaluate(
            "(e, v) => { e.value = v; e.dispatchEvent(new Event('input', { bubbles: true })); }",
            value,
        )
        page.wait_for_timeout(1500)
    took = [page.evaluate(_REGROW, math.log(1000 - k)) for k in range(tries + 2)][2:]
    value = round(statistics.median(took))
    yield limited("slider to regrown tree, 1,000 ends, median", value, "ms", 300) | {
        "tries": tries,
        "longest_ms": round(max(took)),
    }
