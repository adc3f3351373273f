"""Compare a page with its picture of last time, at three sizes.

The pictures stand beside this file in ``looks/``, grey and at half the size. `make looks` draws
them anew: look at what changed before it is committed.
"""

from __future__ import annotations

import importlib.resources
import io
import os
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray
from PIL import Image

SIZES = ((1280, 800), (1024, 768), (400, 800))
FOLDER = Path(__file__).with_name("looks")
WRITE = "PRINTCTL_LOOKS"
BLOCK_PX = 8
"""Of the half-sized picture: a letter moved by a pixel doesn't count, a button moved does."""
MOST_OFF = 24.0
"""Grey levels that a block may be off in its mean."""
MOST_SHARE = 0.004
"""Of all blocks: 8 of 2,000."""

# One font whichever the machine has, no motion, and nothing that depends on the hour or the load.
_STYLE = """
@font-face { font-family: looks; src: url(/looks/looks.ttf); font-weight: 1 1000; }
* { font-family: looks !important; animation: none !important; transition: none !important;
    caret-color: transparent !important; }
progress, [role=progressbar] > *, iframe, video { visibility: hidden !important; }
"""
_NUMBERS_TO_ZERO = """() => {
  window.looks = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode;
    if (!/[\\d/]/.test(node.data) || node.parentElement.closest("script, style")) continue;
    window.looks.push([node, node.data]);
    node.data = node.data
      .replace(/\\/\\S+\\/tty/g, "port")
      .replace(/(Jan|Feb|Mar|Apr|May|Jun|Jul|Aug|Sep|Oct|Nov|Dec) /g, "May ")
      .replace(/\\d[\\d.,:]*( [AP]M)?/g, "0");
  }
}"""
_NUMBERS_BACK = "() => window.looks.forEach(([node, said]) => { node.data = said; })"


def assert_alike(page: Any, name: str, hidden: str = "") -> None:
    """Assert that a page looks as its pictures do; its size is as before then.

    Numbers count as 0, days as May 0, a port as such: what a picture holds is where things are,
    and how they look. What moves is ``hidden`` (a CSS selector).
    """
    before = page.viewport_size
    _dress(page, hidden)
    off = []
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        page.evaluate("scrollTo(0, 0)")
        page.wait_for_timeout(250)
        page.evaluate(_NUMBERS_TO_ZERO)
        drawn = Image.open(io.BytesIO(page.screenshot(caret="hide"))).convert("L")
        page.evaluate(_NUMBERS_BACK)
        off += _compare(drawn.resize((width // 2, height // 2), Image.Resampling.BOX), name)
    page.evaluate("document.querySelector('link[href=\"/looks/looks.css\"]').remove()")
    page.set_viewport_size(before)
    assert not off, "\n".join(off)


def _dress(page: Any, hidden: str) -> None:
    """Put the style in force; page and font come from where the page's policy lets them."""
    font = importlib.resources.files("matplotlib") / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"
    root = "{0.scheme}://{0.netloc}/looks".format(urlsplit(page.url))
    page.route(
        f"{root}/looks.ttf",
        lambda route: route.fulfill(body=font.read_bytes(), content_type="font/ttf"),
    )
    style = _STYLE + (f"{hidden} {{ visibility: hidden !important; }}" if hidden else "")
    page.route(
        f"{root}/looks.css", lambda route: route.fulfill(body=style, content_type="text/css")
    )
    page.evaluate(
        """() => new Promise((done) => {
          const link = Object.assign(document.createElement("link"), {
            rel: "stylesheet", href: "/looks/looks.css",
            onload: () => document.fonts.load("15px looks").then(done),
          });
          document.head.append(link);
        })"""
    )
    page.unroute(f"{root}/looks.ttf")
    page.unroute(f"{root}/looks.css")


def _compare(drawn: Image.Image, name: str) -> list[str]:
    path = FOLDER / f"{name}_{2 * drawn.width}.png"
    if os.environ.get(WRITE):
        FOLDER.mkdir(exist_ok=True)
        drawn.quantize(16).save(path, optimize=True)
        return []
    if not path.is_file():
        return [f"there is no {path.name}; draw it by `make looks`"]
    kept = Image.open(path).convert("L")
    if kept.size != drawn.size:
        return [f"{path.name} has {kept.size}, the page {drawn.size}"]
    off = np.abs(_blocks(drawn) - _blocks(kept)) > MOST_OFF
    if off.mean() <= MOST_SHARE:
        return []
    rows, columns = np.nonzero(off)
    corner = 2 * BLOCK_PX * np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
    seen = path.with_suffix(".seen.png")
    drawn.save(seen)
    return [
        f"{path.name}: {100 * off.mean():.1f} % of the page looks otherwise, between "
        f"{corner[:2].tolist()} and {corner[2:].tolist()} px; see {seen.name}, and draw it anew by "
        "`make looks` if that was meant"
    ]


def _blocks(picture: Image.Image) -> NDArray[np.float64]:
    grey = np.asarray(picture, dtype=float)
    rows, columns = (n // BLOCK_PX for n in grey.shape)
    cut = grey[: rows * BLOCK_PX, : columns * BLOCK_PX]
    means: NDArray[np.float64] = cut.reshape(rows, BLOCK_PX, columns, BLOCK_PX).mean(axis=(1, 3))
    return means
