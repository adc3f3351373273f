"""Verify card of the History page: check an uploaded bundle's contents and signature."""

from __future__ import annotations

import secrets
from typing import Any, Final

from nicegui import ui

from printctl.history.verify import BundleCheck
from printctl.web.history.layout import card
from printctl.web.history.service import HistoryService
from printctl.web.shell.run_or_notify import run_or_notify
from printctl.web.shell.uploading import upload

_MOST_SHOWN: Final = 50


def verify_card(service: HistoryService) -> None:
    """The card with its upload and what it finds."""
    with card("Verify a bundle"):
        ui.label(
            "Is a bundle as it was filed, and who signed it? Without another key, this lab's own "
            "is the one that is trusted."
        )
        key = ui.textarea("Public key to trust (PEM); empty for this lab's own")
        key.props("rows=2 maxlength=2000").style("width:100%")

        async def uploaded(event: Any) -> None:
            path = service.incoming(secrets.token_hex(8))
            try:
                await event.file.save(path)
                check = await run_or_notify(service.verify_file, path, (key.value or "").encode())
            finally:
                path.unlink(missing_ok=True)
            column.clear()
            chosen.reset()
            if check is not None:
                with column:
                    _tell(check, event.file.name)

        chosen = upload("Choose a bundle (zip)", uploaded, ".zip", max_files=1)
        chosen.classes("ph-upload")
        column = ui.element("div").props("role=status")


def _tell(check: BundleCheck, name: str) -> None:
    ui.label(name).classes("ph-name ph-bad")
    for line in check.lines()[: _MOST_SHOWN + 2]:
        ui.label(line).style("white-space:pre-wrap;overflow-wrap:anywhere")
    if check.whole and check.manifest is not None:
        told_print = check.manifest.print
        ui.label(f"{told_print.file}, {told_print.state}, print {told_print.id}")
