"""Write the HTML page of a recipe's tissue, on which places are picked."""

from __future__ import annotations

from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from printctl.errors import UsageError
from printctl.pipeline.tissue_source import make_tissue
from printctl.recipe.load import refusal
from printctl.recipe.tissue import TissuePart
from printctl.web.design.yaml_text import read_text
from registration.report import NetworkPage, ReportSurface, write_places_html


def write_tissue(recipe: Path, path: Path) -> None:
    """Write the page of a recipe's tissue, on which places are picked."""
    section = read_text(recipe.read_text(encoding="utf-8")).get("tissue")
    if not isinstance(section, dict):
        raise UsageError("the recipe has no tissue yet; choose its kind first")
    try:
        part: TissuePart = TypeAdapter(TissuePart).validate_python(section)
    except ValidationError as exc:
        raise UsageError(refusal(exc, "tissue")) from exc
    tissue = make_tissue(part, recipe.parent)
    page = NetworkPage(recipe.stem, notes=tuple(tissue.notes))
    write_places_html(path, ReportSurface("Tissue", tissue.surface), page)
