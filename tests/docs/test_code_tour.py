"""The code tour and the architecture page: true, and the tour on one page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def paths(text: str) -> list[str]:
    """Paths of ours that a page names, such as ``sim/gcode/dry_run/run.py``."""
    roots = "design|docs|examples|firmware_profiles|kernels|printctl|registration|sim|tests"
    return re.findall(rf"`((?:{roots})/[\w/.]*)`", text)


@pytest.mark.parametrize("page", ["code_tour.md", "architecture.md", "firmware_families.md"])
def test_every_path_of_a_page_about_the_code_is_there(page):
    named = paths((DOCS / page).read_text(encoding="utf-8"))
    assert named
    assert [path for path in named if not ("NAME" in path or (ROOT / path).exists())] == []


def test_architecture_names_every_room():
    """Each package of `printctl`, `design`, `sim` and `registration` has a row."""
    page = (DOCS / "architecture.md").read_text(encoding="utf-8")
    rooms = {
        f"{house}/{init.parent.name}/"
        for house in ("design", "printctl", "registration", "sim")
        for init in (ROOT / house).glob("*/__init__.py")
    }
    assert rooms - set(paths(page)) == set()
