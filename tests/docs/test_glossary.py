"""The glossary: few words, and each of them in use."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GLOSSARY = ROOT / "docs" / "glossary.md"
TERMS = re.findall(r"^- \*\*([^*]+)\*\*: ", GLOSSARY.read_text(encoding="utf-8"), re.MULTILINE)
PACKAGES = ("design", "firmware_profiles", "kernels", "printctl", "registration", "sim")
MOST_TERMS, MOST_SENTENCES = 60, 2


@pytest.fixture(scope="module")
def written() -> str:
    """All of the code and the guide but the glossary, in lower case, blanks folded."""
    pages = [page for page in (ROOT / "docs").glob("*.md") if page != GLOSSARY]
    modules = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    text = " ".join(path.read_text(encoding="utf-8") for path in pages + modules)
    return re.sub(r"\s+", " ", text.lower())


@pytest.mark.parametrize("term", TERMS)
def test_each_term_is_in_use(term, written):
    assert re.search(rf"\b{re.escape(term.lower())}", written), f"nobody writes {term!r}"


def test_readme_and_guide_lead_to_the_glossary():
    assert "docs/glossary.md" in (ROOT / "README.md").read_text(encoding="utf-8")
    assert "glossary.md" in (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
