"""The code tour and the architecture page: true, and the tour on one page."""

from __future__ import annotations

import doctest
import json
import re
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from design.tissue import biventricle
from docs_tools import gallery
from firmware_profiles import Needle, load

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def paths(text: str) -> list[str]:
    """Paths of ours that a page names, such as ``gcode/dry_run/run.py``."""
    roots = "benchmarks|design|docs|docs_tools|examples|firmware_profiles|gcode|kernels|printctl"
    roots += "|registration|report|sim|tests"
    return re.findall(rf"`((?:{roots})/[\w/.]*)`", text)


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", *sorted(DOCS.glob("*.md"))])
def test_every_path_that_a_page_names_is_there(page):
    named = paths((ROOT / page).read_text(encoding="utf-8"))
    assert [path for path in named if not ("NAME" in path or (ROOT / path).exists())] == []


def test_architecture_names_every_room():
    """Each package of a top-level package has a row."""
    page = (DOCS / "architecture.md").read_text(encoding="utf-8")
    rooms = {
        f"{house}/{init.parent.name}/"
        for house in ("design", "gcode", "printctl", "registration", "report", "sim")
        for init in (ROOT / house).glob("*/__init__.py")
    }
    assert rooms - set(paths(page)) == set()


# FAQ page: one entry per user-visible error class, and no other.

PACKAGES = ("firmware_profiles", "design", "gcode", "sim", "registration", "report", "printctl")
QUESTIONS = "## Questions that aren't errors"
CLASS = re.compile(r"^ *class (\w+)(?:\[[^:]*\])?\(([^)]*)\):", re.MULTILINE)


@cache
def error_classes() -> set[str]:
    """Public exception classes by source: no module with an extra has to be imported."""
    bases = {}
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            for name, listed in CLASS.findall(path.read_text(encoding="utf-8")):
                bases[name] = {base.strip().split(".")[-1] for base in listed.split(",")}
    known = {"Exception", "ValueError", "RuntimeError", "OSError", "KeyError", "TypeError"}
    while grown := {name for name, of in bases.items() if of & known} - known:
        known |= grown
    # What carries no message for people (a stop that was asked for) is no error.
    return {name for name in known & set(bases) if not name.startswith("_")} - {"PrintEnded"}


def entries() -> set[str]:
    errors, _ = (ROOT / "docs" / "faq.md").read_text(encoding="utf-8").split(QUESTIONS)
    return {line.removeprefix("### ") for line in errors.splitlines() if line.startswith("### ")}


def test_every_public_error_is_in_the_faq():
    assert error_classes() - entries() == set()


def test_the_faq_has_no_error_that_is_gone():
    assert entries() - error_classes() == set()


# The glossary: few words, and each of them in use.

GLOSSARY = ROOT / "docs" / "glossary.md"
TERMS = re.findall(r"^- \*\*([^*]+)\*\*: ", GLOSSARY.read_text(encoding="utf-8"), re.MULTILINE)
PACKAGES_GLOSSARY = (
    "design",
    "firmware_profiles",
    "gcode",
    "kernels",
    "printctl",
    "registration",
    "report",
    "sim",
)


@pytest.fixture(scope="module")
def written() -> str:
    """All of the code and the guide but the glossary, in lower case, blanks folded."""
    pages = [page for page in (ROOT / "docs").glob("*.md") if page != GLOSSARY]
    modules = [path for package in PACKAGES_GLOSSARY for path in (ROOT / package).rglob("*.py")]
    text = " ".join(path.read_text(encoding="utf-8") for path in pages + modules)
    return re.sub(r"\s+", " ", text.lower())


@pytest.mark.parametrize("term", TERMS)
def test_each_term_is_in_use(term, written):
    assert re.search(rf"\b{re.escape(term.lower())}", written), f"nobody writes {term!r}"


def test_readme_and_guide_lead_to_the_glossary():
    assert "docs/glossary.md" in (ROOT / "README.md").read_text(encoding="utf-8")
    assert "glossary.md" in (ROOT / "mkdocs.yml").read_text(encoding="utf-8")


# Python examples of docs/python.md: run as documented.

PAGE = Path(__file__).parents[2] / "docs" / "python.md"


def test_examples_of_the_page_run_as_printed(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = doctest.testfile(
        str(PAGE), module_relative=False, optionflags=doctest.ELLIPSIS | doctest.REPORT_NDIFF
    )
    assert found.attempted > 25
    assert found.failed == 0


# --- the gallery's maker on examples that can't be printed; a shipped heart that can
EXAMPLES = Path(__file__).parents[2] / "examples"
FLOW = {"flow": {"vessel_count": 7, "pressure_drop_mmhg": 2.5}}


def test_a_print_that_is_refused_is_shown_as_designed_with_the_reason(monkeypatch, tmp_path):
    """The gallery ended at a heart of 60 mm, deeper than its needle is long."""
    called: list[tuple[Any, ...]] = []

    def printctl(*words: Any) -> subprocess.CompletedProcess[str]:
        called.append(words)
        if words[0] == "run" and "--until" not in words:
            refusal = "tissue 1 s\nprintctl: refused:\ndepth 60 mm, limit 50\n"
            return subprocess.CompletedProcess(words, 3, "", refusal)
        return subprocess.CompletedProcess(words, 0, json.dumps(FLOW), "")

    monkeypatch.setattr(gallery, "_printctl", printctl)
    monkeypatch.setattr(gallery, "PICTURES", tmp_path)
    path = EXAMPLES / "liver_vessels.yaml"
    known = gallery.make(path)
    assert known["refused"] == "refused: depth 60 mm, limit 50"
    assert known["figures"] == {"vessels": "7", "pressure drop": "2.5 mmHg"}
    assert [words[0] for words in called] == ["run", "run", "view"]
    page = gallery.page({path.stem: known})
    assert "Shown as designed; the print is refused: refused: depth 60 mm, limit 50" in page


def test_the_needle_reaches_the_apex_of_the_shipped_heart() -> None:
    recipe = yaml.safe_load((EXAMPLES / "heart_coronaries.yaml").read_text(encoding="utf-8"))
    height = biventricle(recipe["tissue"]["length_mm"]).vertices[:, 2]
    needle = load(Needle, recipe["toolpath"]["needle"])
    assert needle.length_mm is not None
    assert float(height.max() - height.min()) < needle.length_mm
