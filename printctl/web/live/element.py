"""NiceGUI element that shows the live 3D view of a print."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final
from urllib.parse import quote

from nicegui.element import Element

from printctl.web.live.modules import static_files

_NOT_AT_ONCE: Final = ("element.js", "flat_painter.js")
"""NiceGUI's own, and what only browsers without WebGL draw with."""


class LiveView(Element, component="static/element.js"):
    """The live view of one job.

    The browser fetches the moves by itself, so that an open page costs the server no more than what
    `tell` sends.
    """

    def __init__(self, job: str, *, live: bool = False) -> None:
        """Put the view where the page stands.

        Parameters
        ----------
        job : str
            Name of the job in the URL, as `printctl.web.live.routes.router` knows it.
        live : bool
            Whether the job is being printed, and nothing of it has been reported yet; otherwise all
            of it is shown as planned.
        """
        super().__init__()
        self._props["scene"] = _scene(job)
        self._props["live"] = live
        self.classes("w-full h-full")

    def tell(self, status: Mapping[str, Any]) -> None:
        """Send this page how far the print is.

        Parameters
        ----------
        status : mapping
            ``lines_executed``, ``lines_done``, ``position`` and ``mends`` (lines that were put in,
            `printctl.machine.printing.mend_strokes`), each only if it is known.
        """
        self.run_method("update", dict(status))


def live_view(job: str, *, live: bool = False) -> LiveView:
    """Put the live view of a job into the page; as `LiveView`."""
    return LiveView(job, live=live)


def preload(job: str) -> str:
    """HTML for the head of a page with a job's view.

    With it the browser fetches the moves and the scripts while it reads those of the page, about a
    second earlier.
    """
    scripts = [name for name in static_files() if name.endswith(".js") and name not in _NOT_AT_ONCE]
    moves = f'<link rel="preload" as="fetch" crossorigin href="{_scene(job)}">'
    return moves + "".join(
        f'<link rel="modulepreload" href="/live/static/{name}">' for name in scripts
    )


def _scene(job: str) -> str:
    return f"/live/{quote(job, safe='')}/scene"
