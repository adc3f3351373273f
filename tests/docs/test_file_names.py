"""Source files named in the guide exist."""

import re

import pytest

from tests.system.cli import ROOT

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
FOLDERS = (
    "benchmarks", "design", "docs_tools", "examples", "firmware_profiles", "kernels", "printctl",
    "registration", "sim", "tests",
)  # fmt: skip


@pytest.fixture(scope="module")
def files() -> list[str]:
    return [
        f"/{path.relative_to(ROOT)}" for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")
    ]


def test_source_files_named_in_the_guide_exist(files: list[str]) -> None:
    named = {
        (page.name, name)
        for page in PAGES
        for name in re.findall(r"`([\w/-]+\.py)`", page.read_text(encoding="utf-8"))
    }
    assert len(named) > 50
    assert not [
        (page, name) for page, name in named if not any(one.endswith(f"/{name}") for one in files)
    ]
