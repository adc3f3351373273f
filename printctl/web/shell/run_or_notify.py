"""Run page actions in a thread; show refusals as notifications."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import run, ui

from firmware_profiles import ProfileError
from printctl.failures import message_and_code


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
