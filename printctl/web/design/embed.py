"""Put a finished page in a frame; wait for work in a thread."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Final, TypeVar, cast

from nicegui import run, ui

T = TypeVar("T")


async def run_in_thread(work: Callable[..., T], *args: Any) -> T:
    """Call ``work`` in a thread; what it raises is raised here."""
    return cast(T, await run.io_bound(work, *args))


_MAKER: Final = ThreadPoolExecutor(1, "page maker")


async def make_in_thread(work: Callable[..., T], *args: Any) -> T:
    """Call ``work``, which makes a page and may take minutes; no other call waits behind it."""
    return await asyncio.get_running_loop().run_in_executor(_MAKER, partial(work, *args))


# Show a run's HTML pages in frames with the page's theme; rotate adjacent 3D views together.

_FOLLOW: Final = """
if (!window.pcThemed) {
  window.pcThemed = true;
  const themed = () => {
    const theme = document.documentElement.dataset.theme || "system";
    for (const frame of document.querySelectorAll("iframe[data-page]")) {
      const address = `${frame.dataset.page}?theme=${theme}`;
      if (frame.getAttribute("src") !== address) frame.setAttribute("src", address);
    }
  };
  const reachable = () => {
    for (const box of document.querySelectorAll(".q-table__middle")) box.tabIndex = 0;
  };
  new MutationObserver(reachable).observe(document.body, { subtree: true, childList: true });
  new MutationObserver(themed).observe(document.documentElement,
    { attributes: true, attributeFilter: ["data-theme"] });
  new MutationObserver(themed).observe(document.body,
    { subtree: true, childList: true, attributes: true, attributeFilter: ["data-page"] });
  // A place that was clicked on a tissue (viewer/view.js), from the frame that is for it alone.
  window.addEventListener("message", (event) => {
    if (event.data?.printctl !== "pick") return;
    const frames = [...document.querySelectorAll(".pc-pick iframe")];
    if (!frames.some((frame) => frame.contentWindow === event.source)) return;
    emitEvent("pc_pick", { at: event.data.at });
  });
  // Frames beside each other see the same way (viewer/stage.js).
  window.addEventListener("message", (event) => {
    if (event.data?.printctl !== "view") return;
    const frames = [...document.querySelectorAll(".pc-linked iframe")];
    if (!frames.some((frame) => frame.contentWindow === event.source)) return;
    for (const frame of frames) {
      if (frame.contentWindow === event.source) continue;
      frame.contentWindow.postMessage({ printctl: "view", view: event.data.view }, "*");
    }
  });
  themed();
  reachable();
}
"""


def follow_theme() -> None:
    """Let every embedded page of this browser's page have its theme."""
    ui.run_javascript(_FOLLOW)


def embed(address: str, title: str) -> ui.element:
    """A frame with the page at an address of the API; without one, it is empty."""
    frame = ui.element("iframe").classes("pc-embed")
    frame.props('sandbox="allow-scripts allow-downloads" loading=lazy')
    frame.props["title"] = title
    if address:
        frame.props["data-page"] = address
    return frame
