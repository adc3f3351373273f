"""Templates, style sheet and 3D scene that the offline HTML pages share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final

from jinja2 import ChainableUndefined, Environment, FileSystemLoader
from markupsafe import Markup

from registration.json_ready import is_number
from report.packing import Surfaces, pack_unpacked
from report.picture.colours import NO_DATA, samples
from report.scripts import as_script_json, content_policy, import_map
from report.sections import facts as sections
from report.wording import MISSING, label_and_unit, number, plain

_HERE: Final = Path(__file__).parent


def scene(title: str, surfaces: Surfaces, network: dict[str, object] | None) -> dict[str, object]:
    """A 3D view's data: surfaces, a network of `network_view`, and the colours of both."""
    return {
        "title": title,
        "surfaces": pack_unpacked(surfaces),
        "network": network,
        "colours": page_colours(),
    }


def page_colours() -> dict[str, object]:
    """Colours of the scales of a view, and that of no value."""
    return {"diverging": samples(True), "sequential": samples(False), "none": NO_DATA}


def render(
    template: str, context: Mapping[str, Any], entry: str = "", own_styles: Sequence[Path] = ()
) -> str:
    """Text of a page that holds all it shows.

    Parameters
    ----------
    template : str
        File in ``templates/``.
    context : mapping
        What the template takes besides what all pages have.
    entry : str
        Script that starts the page; its modules go into the page. Empty for a page without scripts.
    own_styles : sequence of Path
        Style sheets after the one that all pages share.
    """
    modules = import_map(entry) if entry else ""
    shared = {
        "style": _text(_HERE / "static" / "report.css"),
        "own_style": Markup("\n").join(map(_text, own_styles)),
        "policy": content_policy([modules, entry] if entry else []),
        "modules": modules,
        "entry": Markup(entry),
    }
    return environment().get_template(template).render(shared | dict(context))


def _text(path: Path) -> Markup:
    return Markup(path.read_text(encoding="utf-8"))


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
