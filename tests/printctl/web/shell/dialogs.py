"""What axe says of a dialog that is open."""

from __future__ import annotations

from typing import Any

import pytest

_BEHIND = ".q-dialog__backdrop, .pc-content, .pc-header { display: none !important }"
_WITHIN = {"include": [["[role=dialog]"]], "exclude": [["[role=dialog] .bg-primary"]]}
"""Axe looks through a dialog, and through a filled button in it, at what lies dimmed behind."""


def serious_in_dialog(page: Any) -> list[str]:
    """Serious findings in the open dialog."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    page.wait_for_timeout(1200)  # it fades in, and axe measures what it sees
    style = page.add_style_tag(content=_BEHIND)
    found = axe.run(page, context=_WITHIN).response["violations"]
    style.evaluate("one => one.remove()")
    bad = [one for one in found if one["impact"] in ("serious", "critical")]
    return [f"{one['id']}: {one['nodes'][0]['html']}" for one in bad]
