"""Shared parts of pages and figures: head, scripts, small multiples, caching."""

from __future__ import annotations

from pathlib import Path

import pytest

from registration.report import network_page

TEMPLATES = Path(network_page.__file__).parent / "templates"
PAGES = ("comparison", "dye", "gcode", "network", "overlay", "report")


@pytest.mark.parametrize("name", PAGES)
def test_every_page_has_the_shared_head_and_no_other(name: str) -> None:
    text = (TEMPLATES / f"{name}.html").read_text(encoding="utf-8")
    assert text.count('{% include "head.html" %}') == 1
    assert "<meta" not in text
