"""Firmware family names occur only in their own packages."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware_profiles.families import family_names

ROOT = Path(__file__).parents[1]
PACKAGES = ("firmware_profiles", "design", "sim", "registration", "printctl", "docs_tools")
HOMES = ("firmware_profiles.families", "sim.devices.families")
NAME = re.compile(rf"\b({'|'.join(family_names())})\b")
WORD = re.compile(rf"firmware|{'|'.join(family_names())}")
SEAM = re.compile(r"""["']\s*[a-zA-Z]?["']|\\""")
"""What may stand within a word in a source: two strings beside each other, a backslash."""
INSIDE = re.compile(rf"({'|'.join(HOMES)})\.({'|'.join(family_names())})\b")


def sources() -> Iterator[Path]:
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            if not any(home.replace(".", "/") in path.as_posix() for home in HOMES):
                yield path


def faults(text: str) -> list[str]:
    """Where a source names a family, or asks a profile which firmware it has."""
    if not WORD.search(SEAM.sub("", text)):
        return []
    tree = ast.parse(text)
    found = []
    prose = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        line = getattr(node, "lineno", 0)
        if isinstance(node, ast.Constant) and id(node) not in prose:
            value = node.value.decode("latin-1") if isinstance(node.value, bytes) else node.value
            if isinstance(value, str) and NAME.search(value):
                found.append(f"line {line} names a family: {value[:60]!r}")
        if any(is_firmware(one) for one in asked(node)):
            found.append(f"line {line} asks which firmware it is: {ast.unparse(node)[:80]}")
        found += [f"line {line} reaches into a home: {name}" for name in reached(node)]
    return found


def asked(node: ast.AST) -> list[ast.expr]:
    """What a node compares, or looks up in a table."""
    if isinstance(node, ast.Compare):
        return [node.left, *node.comparators]
    if isinstance(node, ast.Subscript):
        return [node.slice]
    if isinstance(node, ast.Match):
        return [node.subject]
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        table = node.func.attr in ("get", "startswith", "endswith")
        return [*node.args, node.func.value] if table else []
    return []


def is_firmware(node: ast.expr) -> bool:
    return isinstance(node, ast.Attribute) and node.attr == "firmware"


def reached(node: ast.AST) -> list[str]:
    """Modules of one family that a node imports."""
    if isinstance(node, ast.ImportFrom):
        names = [f"{node.module}.{alias.name}" for alias in node.names]
    else:
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
    return [name for name in names if INSIDE.match(name)]


def test_no_family_is_named_outside_its_home() -> None:
    found = {}
    for path in sources():
        name = path.relative_to(ROOT).as_posix()
        text = path.read_text(encoding="utf-8")
        told = faults(text) if NAME.search(text) or "firmware" in text else []
        if told:
            found[name] = told
    assert not found


@pytest.mark.parametrize(
    "text",
    [
        'if printer.firmware == "x":\n    pass',
        "if printer.firmware in OWN:\n    pass",
        "TABLE[printer.firmware]",
        "found = TABLE.get(printer.firmware, ())",
        "match printer.firmware:\n    case _:\n        pass",
        'FAMILIES = {"klipper": 1}',
        'found = f"say marlin {x}"',
        "from firmware_profiles.families.klipper import FAMILY",
        "from firmware_profiles.families import klipper",
        "import sim.devices.families.marlin.printer",
    ],
)
def test_what_names_a_family_is_found(text: str) -> None:
    assert faults(text)


def test_words_in_a_docstring_and_in_a_sentence_are_none() -> None:
    assert not faults('"""As marlin does."""\nraise ValueError("Marlin reads another number")')
