"""Verify a bundle that somebody brings: drop it here; it is read, not unpacked, and not kept."""

from __future__ import annotations

import secrets
from typing import Any, Final

from nicegui import ui

from printctl.records.verify import Verified
from printctl.web.history.look import card
from printctl.web.history.service import HistoryService
from printctl.web.shell.told import told

_MOST_SHOWN: Final = 50
_CHOOSE: Final = """
<div class="ph-row">
  <q-btn outline no-caps label="Choose a bundle (zip)" @click="props.pickFiles" />
  <span>or drop it here</span>
  <div hidden><q-uploader-add-trigger /></div>
</div>
"""
"""In place of Quasar's own, whose button and field have no names."""


def verify_card(service: HistoryService) -> None:
    """The card with its upload and what it finds."""
    with card("Verify a bundle"):
        ui.label(
            "Is a bundle as it was filed, and who signed it? Without another key, this lab's own "
            "is the one that is trusted."
        )
        key = ui.textarea("Public key to trust (PEM); empty for this lab's own")
        key.props("rows=2 maxlength=2000").style("width:100%")
        upload = ui.upload(label="Bundle (zip)", auto_upload=True, max_files=1)
        upload.props('accept=".zip"').classes("ph-upload")
        upload.add_slot("header", _CHOOSE)
        said = ui.element("div").props("role=status")

        async def uploaded(event: Any) -> None:
            path = service.incoming(secrets.token_hex(8))
            try:
                await event.file.save(path)
                found = await told(service.verify_file, path, (key.value or "").encode())
            finally:
                path.unlink(missing_ok=True)
            said.clear()
            upload.reset()
            if found is not None:
                with said:
                    _tell(found, event.file.name)

        upload.on_upload(uploaded)


def _tell(found: Verified, name: str) -> None:
    ui.label(name).classes("ph-name ph-bad")
    for line in found.lines()[: _MOST_SHOWN + 2]:
        ui.label(line).style("white-space:pre-wrap;overflow-wrap:anywhere")
    if found.whole and found.manifest is not None:
        told_print = found.manifest.print
        ui.label(f"{told_print.file}, {told_print.state}, print {told_print.id}")
