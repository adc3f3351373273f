"""CSS classes used by the pages: each exists in a style sheet."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import printctl.web

WEB = Path(printctl.web.__file__).parent
OURS = re.compile(r"\.((?:\\.|[\w-])+)")


def named(path: Path) -> set[str]:
    """Classes in the calls of ``classes`` of a module."""
    found: set[str] = set()
    for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(call, ast.Call) and getattr(call.func, "attr", "") == "classes":
            found.update(
                word for value in call.args for text in texts(value) for word in text.split()
            )
    return {word for word in found if not word.endswith("-")}  # the rest follows at run time


def texts(value: ast.expr) -> Iterator[str]:
    """What an expression may be, or is put together from; not what it asks or looks up."""
    match value:
        case ast.Constant(value=str(text)):
            yield text
        case ast.IfExp(body=one, orelse=other) | ast.BinOp(left=one, right=other):
            yield from texts(one)
            yield from texts(other)
        case ast.JoinedStr(values=parts):
            for part in parts:
                yield from texts(part)


def known() -> set[str]:
    """Classes that our style sheets and Quasar's have rules for."""
    nicegui = find_spec("nicegui")
    assert nicegui is not None
    assert nicegui.origin is not None
    sheets = [
        *WEB.rglob("*.css"),
        *(Path(nicegui.origin).parent / "static").glob("quasar*prod.css"),
    ]
    text = "\n".join(sheet.read_text(encoding="utf-8") for sheet in sheets)
    return {name.replace("\\", "") for name in OURS.findall(text)}


def test_each_utility_is_in_a_style_sheet() -> None:
    words = set().union(*(named(path) for path in WEB.rglob("*.py")))
    assert {"w-full", "gap-2", "text-sm"} <= words
    of_a_room = re.compile(r"(pc|job|ph|live)-")  # some are for scripts and tests to find
    assert {word for word in words - known() if not of_a_room.match(word)} == set()


def test_no_utility_is_left_over() -> None:
    text = "\n".join(path.read_text(encoding="utf-8") for path in WEB.rglob("*.py"))
    sheet = (WEB / "shell" / "static" / "utilities.css").read_text(encoding="utf-8")
    here = {name.replace("\\", "") for name in re.findall(r"^  \.((?:\\.|[\w-])+)", sheet, re.M)}
    assert {name for name in here if name not in text} == set()
