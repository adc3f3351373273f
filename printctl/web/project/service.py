"""REST of the pages Home and Project: gallery, sketch, and how far each project has come.

A project is a recipe of the workspace with the run of its name, that run's print and report.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import yaml
from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse
from pydantic import Field

from design.units import LengthUnit
from printctl.machine.records.record import JOURNAL, REHEARSAL
from printctl.machine.records.states import ENDED
from printctl.pipeline.run_options import JOB_NAMES
from printctl.recipe.schema import KeyPath
from printctl.run_folder.artefacts import GCODE
from printctl.run_folder.manifest import MANIFEST, Manifest
from printctl.web.core import Core
from printctl.web.design.recipe_text import with_values
from printctl.web.design.recipes import CheckedRecipe
from printctl.web.design.runs import RECIPE, Runs
from printctl.web.detached_runs import RunProgress
from printctl.web.errors import ConflictError
from printctl.web.project.sketch import SketchProcess
from printctl.web.rest import API, REFUSALS, Body
from printctl.web.workspace import Stamp, checked_name, stamp

Step = Literal["shape", "check", "print", "judge", "done"]
LONGEST_REHEARSAL_S: Final = 60.0
"""A rehearsal is made so much faster than the print that it takes about this long."""
MAX_SPEED: Final = 100.0
"""Times real time: faster, a browser shows no more than a film of it."""
Value = Annotated[float, Field(allow_inf_nan=False, ge=-1e6, le=1e6)]


class Changes(Body):
    """Values of a recipe, by their path."""

    values: dict[Annotated[str, Field(max_length=100)], Value] = Field(default={}, max_length=50)


class SavedChanges(Changes):
    """Values to be written into a recipe, and the version that was changed."""

    version: str | None = Field(
        default=None, description="`version` of the project; none for whatever it is by now."
    )


class SketchRequest(Changes):
    """What is to be sketched."""

    known: str = Field(
        default="", max_length=32, description="Tag of the tissue whose outline is there already."
    )


class NewProject(Body):
    """A file to begin with."""

    name: str = Field(max_length=64)
    file: str = Field(max_length=200, description="Taken in by POST /recipes/files.")
    unit: LengthUnit = Field(default="mm", description="Of the file; its format may say it, too.")
    needle: str = Field(default="30g_50mm", max_length=300, description="What it is written with.")
    smallest_diameter_mm: Annotated[float, Field(gt=0, le=20)] | None = Field(
        default=None, description="Of vessels grown in a mesh; what the needle prints if not."
    )
    inlet: Literal["face", "top", "each_part"] = Field(
        default="face",
        description="Where a tree enters a mesh: inside a face, at the highest vertex, or in each "
        "separate part.",
    )


class Rehearsal(Body):
    """How a print is rehearsed."""

    speed: float = Field(ge=0, le=MAX_SPEED, description="Times real time; 0: no clock.")
    version: str | None = Field(default=None, description="`version` of the project.")


@dataclass(frozen=True)
class GalleryEntry:
    """What a new project can begin from: a recipe, and its print time by the dry run, min."""

    example: str
    title: str
    shows: str
    size: str
    print_min: float


@dataclass(frozen=True)
class Slider:
    """A value of a recipe that matters, with the range in which it is tried.

    ``path`` has the keys of the recipe, joined by dots; ``value`` and range are in ``unit``.
    """

    path: str
    label: str
    unit: str
    hint: str
    value: float
    least: float
    most: float
    step: float


@dataclass(frozen=True)
class ProjectCheck:
    """Something that was checked before the print, which is refused if it ``refuses`` and failed.

    ``kind`` is a `Kind`'s value; ``value`` and ``limit`` are in ``unit``, None where there is no
    number.
    """

    kind: str
    check: str
    passed: bool
    refuses: bool
    value: float | None
    limit: float | None
    unit: str
    place: str
    remedy: str


@dataclass(frozen=True)
class ProjectRow:
    """A project in the list: ``modified`` s since 1970, and the ``step`` that comes next."""

    name: str
    modified: float
    step: Step


@dataclass(frozen=True)
class Project:
    """A project, how far it has come, and the ``step`` that comes next.

    Attributes
    ----------
    version : str
        Of the recipe's text; to be sent back with changes.
    problems : tuple of str
        Why the recipe can't be used.
    run : RunProgress
        Of the design, or of the rehearsal while that is going on.
    judged : str
        Run of whose report ``reasons`` and ``passed`` are: the project's, or its rehearsal's.
    made : bool
        Whether the design is made and is the recipe's as it stands.
    rehearsal_speed : float
        Times real time at which a rehearsal takes about a minute.
    rehearsal_broken : bool
        Whether the last rehearsal failed or was ended, so that nothing was judged.
    """

    name: str
    version: str
    step: Step
    problems: tuple[str, ...]
    sliders: tuple[Slider, ...]
    run: RunProgress
    judged: str
    made: bool
    checks: tuple[ProjectCheck, ...]
    print_time_s: float | None
    rehearsal_speed: float
    rehearsal_broken: bool
    print_state: str
    has_report: bool
    reasons: tuple[str, ...]
    passed: bool | None


_Design = tuple[tuple[ProjectCheck, ...], float | None]
"""What dry run and lumens say of a design: checks, and print time, s."""


@dataclass(frozen=True)
class _Reached:
    """What is made of a recipe as it stands: design, its print, and the verdict on that."""

    design: _Design | None = None
    print_state: str = ""
    judged: str = ""
    verdict: dict[str, Any] | None = None

    @property
    def step(self) -> Step:
        """What comes next."""
        if self.design is None:
            return "shape"
        if self.verdict is not None:
            return "done"
        if self.print_state == "done":
            return "judge"
        refused = any(not one.passed and one.refuses for one in self.design[0])
        return "check" if refused else "print"


class ProjectService:
    """The guided way over a workspace's recipes and their runs; any thread may call."""

    def __init__(self, core: Core, runs: Runs) -> None:
        self._workspace, self._events = core.workspace, core.events
        self._runs, self._recipes = runs, runs.recipes
        self.sketches = SketchProcess()

    def projects(self) -> list[ProjectRow]:
        """All projects, the one changed last first."""
        rows = []
        for name in self._recipes.names():
            paths = (self._workspace.recipe(name), self._workspace.run(name))
            modified = max(path.stat().st_mtime for path in paths if path.exists())
            step = self._reached(name, self._recipes.text(name)).step
            rows.append(ProjectRow(name, modified, step))
        return sorted(rows, key=lambda row: -row.modified)

    def project(self, name: str) -> Project:
        """Return how far a project has come."""
        recipe = self._recipes.read(name)
        reached, rehearsal = self._reached(name, recipe.text), self._runs.progress(name + REHEARSAL)
        verdict, (checks, time_s) = reached.verdict, reached.design or ((), None)
        return Project(
            name=name,
            version=recipe.version,
            step=reached.step,
            problems=tuple(one.message for one in recipe.problems),
            sliders=sliders(recipe),
            run=rehearsal if rehearsal.going_on else self._runs.progress(name),
            judged=reached.judged,
            made=reached.design is not None,
            checks=tuple(sorted(checks, key=lambda one: (one.passed, not one.refuses))),
            print_time_s=time_s,
            rehearsal_speed=min(max(round((time_s or 0.0) / LONGEST_REHEARSAL_S), 1), MAX_SPEED),
            rehearsal_broken=verdict is None and rehearsal.state in ("failed", "interrupted"),
            print_state=reached.print_state,
            has_report=verdict is not None,
            reasons=tuple(verdict.get("reasons", ())) if verdict else (),
            passed=bool(verdict["passed"]) if verdict else None,
        )

    def begin(self, request: NewProject) -> Project:
        """Begin a project with a file beside the recipes.

        A mesh becomes a tissue in which a tree is grown; a network is written as it is.
        """
        name, file = checked_name(request.name), request.file
        suffix, unit = Path(file).suffix.lower(), {"unit": request.unit}
        recipe: dict[str, Any] = {"schema": 1, "name": name, "seed": 1}
        if suffix in (".stl", ".obj", ".ply", ".3mf"):
            recipe["tissue"] = {"mesh": file} | unit
            recipe["vasculature"] = {"grow": "tree", "terminals": 100} | _ENTRIES[request.inlet]
            if request.smallest_diameter_mm is not None:
                recipe["vasculature"]["smallest_diameter_mm"] = request.smallest_diameter_mm
        else:
            takes = suffix in (".csv", ".vtp", ".swc")
            takes |= suffix == ".txt" and "unit" in request.model_fields_set  # else in cm
            said = unit if takes else {}
            recipe["vasculature"] = {"network": file} | said
        text = "# Begun on the page; every key is explained in docs/recipe.md.\n"
        toolpath = _EMBEDDED["toolpath"] | {"needle": request.needle}
        text += yaml.safe_dump(recipe | _EMBEDDED | {"toolpath": toolpath}, sort_keys=False)
        self._recipes.check(text).usable()
        self._recipes.write(name, text)
        return self.project(name)

    async def sketch(self, name: str, asked: SketchRequest, request: Request) -> JSONResponse:
        """Straight pieces of vessels: x, y, z of both ends and both radii, mm, eight a piece."""
        text = with_values(self._recipes.text(name), _by_keys(asked.values))
        recipe = self._recipes.check(text).usable().model_dump(mode="json", by_alias=True)
        behind = not self._events.latest.get("print", {"ended": True})["ended"]
        found = await self.sketches.sketch(
            recipe, self._recipes.folder, asked.known, behind, request.is_disconnected
        )
        return JSONResponse(found)  # as it is: FastAPI would look at each of its numbers

    def change(self, name: str, request: SavedChanges) -> Project:
        """Write values of sliders into the recipe; it stays as it is if it can't be used so.

        ConflictError while a run or print of it goes on, or where it was changed since.
        """
        before = self._recipes.read(name)
        text = with_values(before.text, _by_keys(request.values))
        self._recipes.check(text).usable()
        self._runs.refuse_going_on(name)
        self._recipes.write(name, text, request.version or before.version)
        return self.project(name)

    def rehearse(self, name: str, request: Rehearsal) -> RunProgress:
        """Print the design on the simulated printer, scan it by the simulated scanner, judge it.

        It is refused before the design is made, and while a run or print of it goes on.
        """
        if self._reached(name, self._recipes.text(name)).design is None:
            raise ConflictError(f"the design of {name!r} isn't made as the recipe stands; make it")
        return self._runs.rehearse(name, request.speed, request.version)

    def _reached(self, name: str, text: str) -> _Reached:
        folder = self._workspace.run(name)
        design = self._design(folder, text)
        if design is None:
            return _Reached()
        state, judged = self._runs.print_state(name), name
        verdict = _verdict(folder) if state in ENDED else None
        if verdict is None and state != "done":
            judged = name + REHEARSAL
            rehearsal = self._workspace.run(judged)
            verdict = _verdict(rehearsal) if self._design(rehearsal, text) else None
        return _Reached(design, state, judged if verdict else "", verdict)

    def _design(self, folder: Path, text: str) -> _Design | None:
        """The design of a run that has G-code, checked, of the recipe as it stands."""
        try:
            same = (folder / RECIPE).read_text(encoding="utf-8") == text
        except OSError:
            return None
        if not same or not (folder / GCODE).is_file() or not (folder / MANIFEST).is_file():
            return None
        ended = {one.name: one.state for one in self._runs.progress(folder.name).stages}
        made = all(ended.get(one, "done") == "done" for one in JOB_NAMES)
        return _checked_design(folder, stamp(folder / MANIFEST)) if made else None


def router(service: ProjectService) -> APIRouter:
    """Routes of the guided way."""
    routes, one = APIRouter(prefix=API, tags=["projects"], responses=REFUSALS), "/projects/{name}"
    routes.get("/gallery", summary="What a new project can begin from")(gallery)
    routes.get("/projects", summary="Recipes with what they have reached, the newest first")(
        service.projects
    )
    routes.post("/projects", summary="Begin with a mesh or a network")(service.begin)
    routes.get(one, summary="How far a project has come")(service.project)
    routes.patch(one, summary="Write values into its recipe")(service.change)
    routes.post(
        f"{one}/sketch",
        summary="The vessels with other values; keeps nothing",
        response_model=dict[str, Any],
    )(service.sketch)
    routes.post(f"{one}/rehearse", summary="Print, scan and judge it, all simulated")(
        service.rehearse
    )
    return routes


def _by_keys(values: dict[str, float]) -> dict[KeyPath, float]:
    """Return values, whole numbers as such, by the keys of their dotted paths."""
    return {
        tuple(int(key) if key.isdecimal() else key for key in path.split(".")): (
            int(value) if value == int(value) else value
        )
        for path, value in values.items()
    }


_ENTRIES: Final[dict[str, dict[str, Any]]] = {
    "face": {"printable": True},
    "top": {"printable": True, "root": "top"},
    "each_part": {"inlets": "each_part"},
}
"""What a recipe says of where a tree enters."""

# How a file that a user brings is printed, until somebody says otherwise.
_EMBEDDED: Final[dict[str, Any]] = {
    "flow": {"viscosity_mpa_s": 1.0, "inlet_flow_ml_min": 1.0},
    "toolpath": {"method": "embedded", "needle": "30g_50mm"},
    "printer": {
        "profile": "generic_marlin",
        "port": "simulated",
        "syringe": "hamilton_2_5ml",
        "ink": "gelatin_sacrificial",
        "bath": "cell_matrix",
    },
}


@cache
def gallery() -> list[GalleryEntry]:
    """Examples with pictures."""
    text = Path(__file__).with_name("gallery.yaml").read_text(encoding="utf-8")
    return [GalleryEntry(**one) for one in yaml.safe_load(text)]


# Values that matter: keys of the recipe, label, unit, hint, least, most, step.
_SLIDERS: Final = (
    ("tissue.length_mm", "Length", "mm", "Of the whole organ.", 20.0, 120.0, 1.0),
    ("tissue.width_mm", "Width", "mm", "Of the whole organ.", 20.0, 150.0, 1.0),
    ("tissue.diameter_mm", "Diameter", "mm", "Of the tissue.", 3.0, 40.0, 0.5),
    ("tissue.height_mm", "Height", "mm", "Of the tissue.", 2.0, 40.0, 0.5),
    ("tissue.outer_diameter_mm", "Outer diameter", "mm", "Of the ring.", 10.0, 60.0, 0.5),
    ("tissue.size_mm.0", "Length", "mm", "Of the block, in x.", 5.0, 60.0, 0.5),
    ("tissue.size_mm.1", "Width", "mm", "Of the block, in y.", 5.0, 60.0, 0.5),
    ("tissue.size_mm.2", "Height", "mm", "Of the block, in z.", 1.0, 40.0, 0.5),
    ("vasculature.terminals", "Ends", "", "Smallest vessels that feed the tissue.", 2, 1000, 1),
    (
        "vasculature.smallest_diameter_mm", "Smallest diameter", "mm",
        "No vessel is narrower. The needle writes no line much thinner than its bore.",
        0.05, 1.0, 0.01,
    ),
    (
        "vasculature.clearance_mm", "Clearance", "mm", "Tissue between vessels that don't meet.",
        0.0, 1.0, 0.01,
    ),
    ("seed", "Variant", "", "Another number grows another tree of the same kind.", 1, 50, 1),
)  # fmt: skip


def sliders(checked: CheckedRecipe) -> tuple[Slider, ...]:
    """The values that matter of a recipe, those that its sections have; none of one with problems.

    A block's size is left out where the network comes with the design, as it was made for it.
    """
    if not checked.valid:
        return ()
    data = checked.usable().model_dump(mode="json")
    grown = "terminals" in data["vasculature"] and data["vasculature"]["terminals"] is not None
    found = []
    for path, label, unit, hint, least, most, step in _SLIDERS:
        value = _value(data, path.split("."))
        if grown and value is not None:
            least, most = min(least, value), max(most, value)
            found.append(Slider(path, label, unit, hint, value, least, most, step))
    return tuple(found)


def _value(data: Any, keys: list[str]) -> float | None:
    try:
        for key in keys:
            data = data[int(key) if isinstance(data, list) else key]
    except (LookupError, TypeError):
        return None
    return data if isinstance(data, int | float) else None


@lru_cache(maxsize=256)
def _checked_design(folder: Path, of: Stamp) -> _Design | None:
    """A run's design by its manifest, a file of up to a megabyte; None before the dry run."""
    stages = Manifest.load(folder).stages
    if "dry run" not in stages:
        return None
    found = []
    for one in stages["dry run"].summary.get("checks", ()):
        counted = one["value"] or one["limit"] or one["unit"]  # else it is a question to a person
        value, limit = (one["value"], one["limit"]) if counted else (None, None)
        refuses, remedy = one["weight"] == "refuses", "" if one["passed"] else one["remedy"]
        given = (
            one.get("kind", ""),
            one["check"],
            one["passed"],
            refuses,
            value,
            limit,
            one["unit"],
            one["place"],
        )
        found.append(ProjectCheck(*given, remedy))
    lumens = stages["lumens"].summary if "lumens" in stages else {}
    if lumens.get("checked"):
        counts, passed = lumens["summary"], bool(lumens["passed"])
        remedy = "" if passed else "take thinner lines or wider vessels"
        count, all_ = float(counts["lumens"] - counts["closed"]), float(counts["lumens"])
        check = "lumens open, and without leaks, by the G-code"
        found.append(ProjectCheck("lumens", check, passed, False, count, all_, "open", "", remedy))
    return tuple(found), stages["dry run"].summary.get("print_time_s")


def _verdict(folder: Path) -> dict[str, Any] | None:
    """The verdict of a run's report, if that is newer than its G-code and its last print."""
    path, printed = folder / "report.json", folder / "print" / JOURNAL
    try:
        made = [one.stat().st_mtime for one in (folder / GCODE, printed) if one.exists()]
        if path.stat().st_mtime < max(made):
            return None
        return _read_verdict(path, stamp(path))
    except (OSError, ValueError):
        return None


@lru_cache(maxsize=256)
def _read_verdict(path: Path, of: Stamp) -> dict[str, Any] | None:
    verdict: dict[str, Any] | None = json.loads(path.read_text(encoding="utf-8")).get("verdict")
    return verdict
