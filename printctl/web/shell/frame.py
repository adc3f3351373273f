"""Frame of every page: header, dialogs, uploads, notices."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from typing import Any, Final

from nicegui import run, ui

from firmware_profiles import ProfileError
from printctl.failures import message_and_code
from printctl.web.controls import Principal
from printctl.web.shell.assets import FOLDER, link
from printctl.web.workspace import Workspace

log = logging.getLogger("printctl.web")


def this_browser() -> Principal:
    """The browser that the page being built or answering is for; set by the guard at the door."""
    request = ui.context.client.request
    principal = getattr(request.state, "principal", None) if request is not None else None
    return principal or Principal("local", "this browser")


async def add_unusable_names(workspace: Workspace, *patterns: str) -> None:
    """Say which files of patterns in the workspace a list leaves out for their names, if any."""
    if names := await run.io_bound(workspace.unusable_names, *patterns):
        ui.label(
            f"Not shown: {', '.join(names)}. Rename each: 1 to 64 letters a to z, digits, '.', '_' "
            "or '-', beginning with a letter or digit."
        ).classes("text-sm break-all")


def dialog_named(name: str) -> ui.dialog:
    """A dialog; its name is read out when it opens."""
    made = ui.dialog()
    made.props["aria-label"] = name
    return made


async def run_or_notify(work: Callable[..., Any], *args: Any, **values: Any) -> Any:
    """Call ``work`` in a thread; a refusal becomes a note on the page, and None is given back."""
    try:
        return await run.io_bound(work, *args, **values)
    except Exception as exc:
        known = message_and_code(exc)
        if known is None and not isinstance(exc, ProfileError):
            raise
        ui.notify(
            known[0] if known else str(exc),
            type="negative",
            multi_line=True,
            timeout=0,
            close_button="OK",
        )
        return None


def upload(text: str, take: Callable[..., Any], kinds: str = "", **values: Any) -> ui.upload:
    """A place to drop files, with a button that has a name for those who hear the page.

    Parameters
    ----------
    text : str
        The button's; the program's own.
    take : function
        Given the event of an upload.
    kinds : str, optional
        Suffixes or media types that can be chosen; empty for all.
    **values
        Further ones of `ui.upload`.
    """
    made = ui.upload(auto_upload=True, on_upload=take, **values)
    made.props("flat bordered").classes("w-full pc-upload")
    if kinds:
        made.props["accept"] = kinds
    made.add_slot(
        "header",
        f"""
        <div class="row items-center q-pa-xs"><q-btn flat no-caps icon="add"
          label="{escape(text)}" class="min-h-[48px]" @click="props.pickFiles"></q-btn>
          <span class="q-px-sm">or drop it here</span>
          <div style="display: none"><q-uploader-add-trigger></q-uploader-add-trigger></div></div>
        """,
    )
    return made


PAGES: Final = {
    "/printer": "Printer",
    "/job": "Job",
    "/design": "Design",
    "/scan": "Scan",
    "/history": "History",
}
BLUE: Final = "#0b5cad"
"""Of filled buttons: white on it has a contrast of 6.6 : 1, in light and dark."""


@contextmanager
def frame(path: str) -> Iterator[None]:
    """Put what is made inside below the header of the page at ``path``, as its content.

    The page's name is its h1; headings inside begin with h2.
    """
    name = PAGES[path]
    guard = getattr(ui.context.client.request.state, "guard", None)
    ui.colors(primary=BLUE)
    ui.page_title(f"{name} · printctl")
    ui.add_head_html(head(guard.stop_port if guard else 0))
    ui.add_body_html(header(path, leave=guard is not None and not guard.settings.open))
    with ui.element("div").classes("pc-content").props("id=content tabindex=-1"):
        ui.html(escape(name), tag="h1", sanitize=False).classes("pc-title")
        with contained(f"The page {name}"):
            yield


@contextmanager
def contained(part: str) -> Iterator[None]:
    """Say on the page that a part of it failed; the rest, above all STOP, is shown all the same.

    Parameters
    ----------
    part : str
        Name of the part, at the beginning of a sentence.
    """
    try:
        yield
    except Exception as exc:
        log.exception("%s can't be shown", part)
        known = message_and_code(exc)
        reason = known[0] if known else f"internal error {type(exc).__name__}, see the server's log"
        ui.label(f"{part} can't be shown in full: {reason}. STOP above works.").props("role=alert")


def head(stop_port: int) -> str:
    """Style and scripts; the stop's is among the first, and none waits for NiceGUI's.

    Parameters
    ----------
    stop_port : int
        Of the stop process; 0 for none.
    """
    door = f'<meta name="printctl-stop-port" content="{stop_port}">\n' if stop_port else ""
    return (
        f'{door}<link rel="stylesheet" href="{link("utilities.css")}">\n'
        f'<link rel="stylesheet" href="{link("shell.css")}">\n'
        f'<script src="{link("theme.js")}"></script>\n'
        f'<script src="{link("stop.js")}"></script>\n'
        f'<script src="{link("shell.js")}" defer></script>'
    )


def header(path: str, leave: bool) -> str:
    """The header's HTML, with the page at ``path`` marked as the current one.

    Parameters
    ----------
    path : str
    leave : bool
        Whether it has a button to log out.
    """
    ways = "".join(
        f'<a href="{way}"{_CURRENT if path == way else ""}>{escape(name)}</a>'
        for way, name in PAGES.items()
    )
    whole = (FOLDER / "header.html").read_text(encoding="utf-8").replace("<!--ways-->", ways)
    return whole.replace("<!--leave-->", _LEAVE if leave else "")


_CURRENT: Final = ' aria-current="page"'
_LEAVE: Final = (
    '<form method="post" action="/logout">'
    '<button class="pc-button" type="submit">Log out</button></form>'
)
