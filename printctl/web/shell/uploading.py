"""Accessible file drop area, shared by all pages."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import Any

from nicegui import ui


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
