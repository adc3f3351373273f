"""Service behind the Design page and its REST routes: recipes, runs, figures, files, comparison."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from printctl.web.core import Core
from printctl.web.design.recipes import Recipes
from printctl.web.design.run_views import (
    Comparison,
    Figure,
    compare_runs,
    gcode_page,
    key_figures,
    network_page,
    tissue_page,
)
from printctl.web.design.runs import RunProgress, Runs
from printctl.web.errors import NotFoundError

ARTEFACTS: Final[dict[str, str]] = {
    "recipe.yaml": "text/plain; charset=utf-8",
    "run.log": "text/plain; charset=utf-8",
    "manifest.json": "application/json",
    "network.csv": "text/csv",
    "network.vtp": "application/xml",
    "flow.csv": "text/csv",
    "oxygen.csv": "text/csv",
    "measures.json": "application/json",
    "tissue.stl": "model/stl",
    "lumen.stl": "model/stl",
    "solid.stl": "model/stl",
    "solid.3mf": "model/3mf",
    "part.gcode": "text/plain; charset=utf-8",
    "dry_run.json": "application/json",
    "predicted_bead.csv": "text/csv",
    "predicted_layers.csv": "text/csv",
    "lumens.json": "application/json",
    "time_line.png": "image/png",
    "report.json": "application/json",
    "report.pdf": "application/pdf",
    "registration.json": "application/json",
    "vessels.csv": "text/csv",
    "sections.csv": "text/csv",
    "defects.csv": "text/csv",
    "deviation.ply": "model/ply",
    "deviation.vtp": "application/xml",
    "sections.vtp": "application/xml",
    "scan_in_part.nrrd": "application/octet-stream",
}
"""Files of a run that may be fetched, and what they are."""

PAGES: Final = ("network", "layers", "dry_run", "report")
"""Pages of a run that are shown inside the page."""
_WHEN: Final = {
    "dry_run": "make the design as far as the dry run",
    "report": "print the design, then let Make continue with scan, registration and report",
}


class DesignService:
    """Recipes, runs of them, and what came of these."""

    def __init__(self, core: Core) -> None:
        self.core = core
        self.recipes = Recipes(core.workspace)
        self.runs = Runs(core.workspace, self.recipes)

    def progress(self, run: str) -> RunProgress:
        """How far a run is, and once it has ended its print."""
        now = self.runs.progress(run)
        return now if now.going_on else replace(now, print_state=self.runs.print_state(run))

    def figures(self, run: str) -> list[Figure]:
        """Key figures of a run.

        Raises
        ------
        NotFoundError
        """
        return key_figures(self.runs.folder(run))

    def compare(self, one: str, other: str) -> Comparison:
        """Two runs beside each other.

        Raises
        ------
        NotFoundError
        """
        return compare_runs(self.runs.folder(one), self.runs.folder(other))

    def artefacts(self, run: str) -> list[str]:
        """Files of a run that may be fetched and are there."""
        folder = self.runs.folder(run)
        return [name for name in ARTEFACTS if (folder / name).is_file()]

    def artefact(self, run: str, name: str) -> Path:
        """A file of a run.

        Raises
        ------
        NotFoundError
            When it isn't there, or isn't one that may be fetched.
        """
        path = self.runs.folder(run) / name if name in ARTEFACTS else None
        if path is None or not path.is_file() or path.is_symlink():
            raise NotFoundError(f"run {run!r} has no file {name[:80]!r} that can be fetched")
        return path

    def tissue(self, recipe: str) -> Path:
        """The page of a recipe's tissue, on which places are picked.

        Raises
        ------
        NotFoundError
        BadRequestError
            When the recipe can't be read.
        ConflictError
            When the tissue can't be made.
        """
        section = (self.recipes.read(recipe).data or {}).get("tissue")
        path = self.core.workspace.recipe(recipe)
        return tissue_page(path, section, self.core.workspace.private / "pages")

    def page(self, run: str, name: str) -> Path:
        """A page of a run: of its network, layers, dry run or report.

        Raises
        ------
        NotFoundError, ConflictError
        """
        folder, kept = self.runs.folder(run), self.core.workspace.private / "pages"
        for one in folder.iterdir():  # a page is made of several
            self.core.workspace.inside(one)
        if name == "network":
            return network_page(folder, kept)
        if name == "layers":
            return gcode_page(folder, kept)
        path = folder / f"{name}.html"
        if name not in PAGES or not path.is_file():
            when = _WHEN.get(name, "there is no such page")
            raise NotFoundError(f"run {run!r} has no page {name[:80]!r} yet: {when}")
        return path
