"""First lines of modules, and docstrings of packages, as a stranger meets them."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = (
    "design",
    "docs_tools",
    "firmware_profiles",
    "gcode",
    "kernels",
    "printctl",
    "registration",
    "report",
    "sim",
)
MODULES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
DOCS = {
    path.relative_to(ROOT): ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    for path in MODULES
}
UNCLEAR = re.compile(r"(?:What|Which|Where|Who|Why|How|When|Whether|It|They|This|These|As)\b", re.I)
NAMED = re.compile(r"Begin\s+with\s+`([\w/]+\.py)`")


def first_line(doc: str) -> str:
    return " ".join(doc.split("\n\n")[0].split())


def test_no_first_line_begins_with_a_question_word_or_a_pronoun():
    assert len(DOCS) > 500
    assert [str(path) for path, doc in DOCS.items() if UNCLEAR.match(first_line(doc))] == []


def test_every_first_line_is_one_sentence():
    wrong = [
        str(path)
        for path, doc in DOCS.items()
        if not first_line(doc).rstrip(")").endswith(".") or len(first_line(doc).split()) < 2
    ]
    assert wrong == []


def test_every_package_says_which_file_to_begin_with():
    for path, doc in DOCS.items():
        if path.name == "__init__.py":
            named = NAMED.search(doc)
            assert named, f"{path} doesn't say which file to begin with"
            assert (ROOT / path.parent / named[1]).exists(), f"{path} names {named[1]}"
