"""Accessibility findings (axe) on an open dialog."""

from __future__ import annotations

from typing import Any

from tests.printctl.web.shell.browsers import serious

_BEHIND = ".q-dialog__backdrop, .pc-content, .pc-header { display: none !important }"
_WITHIN = {"include": [["[role=dialog]"]], "exclude": [["[role=dialog] .bg-primary"]]}
"""Axe looks through a dialog, and through a filled button in it, at what lies dimmed behind."""


def serious_in_dialog(page: Any) -> list[str]:
    """Serious findings in the open dialog."""
    page.wait_for_timeout(1200)  # it fades in, and axe measures what it sees
    style = page.add_style_tag(content=_BEHIND)
    found = serious(page, _WITHIN)
    style.evaluate("one => one.remove()")
    return found
