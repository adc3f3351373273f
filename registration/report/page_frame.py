"""Templates, style sheet and 3D scene that the offline HTML pages share."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any, Final

from jinja2 import ChainableUndefined, Environment, FileSystemLoader
from markupsafe import Markup

from registration.json_ready import is_number
from registration.report import sections
from registration.report.packing import Surfaces, pack_unpacked
from registration.report.picture.colours import NO_DATA, samples
from registration.report.scripts import as_script_json
from registration.report.wording import MISSING, label_and_unit, number, plain

_HERE: Final = Path(__file__).parent


def scene(title: str, surfaces: Surfaces, network: dict[str, Any] | None) -> dict[str, Any]:
    """A 3D view's data: surfaces, a network of `network_view`, and the colours of both."""
    return {
        "title": title,
        "surfaces": pack_unpacked(surfaces),
        "network": network,
        "colours": {"diverging": samples(True), "sequential": samples(False), "none": NO_DATA},
    }


def style() -> Markup:
    """The pages' style sheet."""
    return Markup((_HERE / "static" / "report.css").read_text(encoding="utf-8"))


@cache
def environment() -> Environment:
    """Templates and filters of the pages."""
    environment = Environment(
        loader=FileSystemLoader(_HERE / "templates"),
        autoescape=True,
        undefined=ChainableUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": number,
        "plain": lambda value: MISSING if value is None else plain(value),
        "label": lambda key: label_and_unit(str(key))[0],
        "unit": lambda key: label_and_unit(str(key))[1],
        "facts": sections.facts,
        "script_json": as_script_json,
    }
    environment.tests["matrix"] = _is_matrix
    return environment


def _is_matrix(value: Any) -> bool:
    return (
        isinstance(value, list)
        and len(value) > 1
        and all(isinstance(row, list) and all(is_number(v) for v in row) for row in value)
    )
