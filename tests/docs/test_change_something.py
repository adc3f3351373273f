"""Documentation page on common changes: names existing files, and few."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "change_something.md").read_text(encoding="utf-8")
TABLE = [line for line in PAGE.splitlines() if line.startswith("| ")][1:]
ROWS = [[cell.strip() for cell in line.split("|")[1:-1]] for line in TABLE]
MOST_FILES, MOST_HOUSES = 4, 2


def paths(cell: str) -> list[str]:
    return re.findall(r"`([a-z_]+/[\w/.]+)`", cell)


@pytest.mark.parametrize("row", ROWS, ids=[row[0] for row in ROWS])
def test_what_a_change_touches_is_there_and_little(row):
    touched = paths(row[1])
    assert 1 <= len(touched) <= MOST_FILES
    assert len({path.split("/")[0] for path in touched}) <= MOST_HOUSES
    for path in touched + paths(row[2]):
        assert (ROOT / path).exists(), f"docs/change_something.md: {path} isn't there any more"
