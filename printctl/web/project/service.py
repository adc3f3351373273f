"""Service behind the pages Home and Project: gallery, sketch, and how far each project has come.

A project is a recipe of the workspace with the run of its name, that run's print and report.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal

import yaml

from design.units import LengthUnit
from printctl.machine.link.states import ENDED
from printctl.pipeline.run_options import JOB_NAMES, REHEARSAL
from printctl.run_folder.artefacts import GCODE
from printctl.run_folder.manifest import Manifest
from printctl.web.core import Core
from printctl.web.design.recipe_text import read_text, rewrite_yaml
from printctl.web.design.recipes import EXAMPLES, CheckedRecipe
from printctl.web.design.runs import RECIPE, RunProgress
from printctl.web.design.service import DesignService
from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.project.sketch import Gone, SketchProcess
from printctl.web.workspace import checked_name

Step = Literal["shape", "check", "print", "judge", "done"]
LONGEST_REHEARSAL_S: Final = 60.0
"""A rehearsal is made so much faster than the print that it takes about this long."""
MAX_SPEED: Final = 100.0
"""Times real time: faster, a browser shows no more than a film of it."""


@dataclass(frozen=True)
class GalleryEntry:
    """What a new project can begin from.

    Attributes
    ----------
    example : str
        Name of the recipe.
    title, shows : str
        In a few words, and in a sentence.
    size : str
    print_min : float, min
        By the dry run.
    """

    example: str
    title: str
    shows: str
    size: str
    print_min: float


@dataclass(frozen=True)
class Slider:
    """A value of a recipe that matters, with the range in which it is tried.

    Attributes
    ----------
    path : str
        Keys of the recipe, joined by dots.
    label, unit, hint : str
    value, least, most, step : float
        In ``unit``.
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
    """Something that was checked before the print.

    Attributes
    ----------
    check : str
    passed, refuses : bool
        Whether it is as it should be, and whether the print is refused where it isn't.
    value, limit : float or None
        In ``unit``; None where there is no number.
    unit, place, remedy : str
    """

    check: str
    passed: bool
    refuses: bool
    value: float | None = None
    limit: float | None = None
    unit: str = ""
    place: str = ""
    remedy: str = ""


@dataclass(frozen=True)
class ProjectRow:
    """A project in the list.

    Attributes
    ----------
    name : str
    modified : float, s since 1970
    step : Step
        What comes next.
    """

    name: str
    modified: float
    step: Step


@dataclass(frozen=True)
class Project:
    """A project, and how far it has come.

    Attributes
    ----------
    name : str
    step : Step
        What comes next.
    problems : tuple of str
        Why the recipe can't be used.
    sliders : tuple of Slider
    run : RunProgress
        Of the design, or of the rehearsal while that is going on.
    judged : str
        Run whose report it is: the project's, or its rehearsal's; empty without one.
    made : bool
        Whether the design is made and is the recipe's as it stands.
    checks : tuple of ProjectCheck
        All that was checked; those that refuse the print first.
    print_time_s : float or None, s
    rehearsal_speed : float
        Times real time at which a rehearsal takes about a minute.
    print_state : str
        Of its last print; empty when there was none.
    has_report : bool
    reasons : tuple of str
        What the report's verdict rests on.
    passed : bool or None
        Whether the print is as designed; None without a report.
    """

    name: str
    step: Step
    problems: tuple[str, ...]
    sliders: tuple[Slider, ...]
    run: RunProgress
    judged: str
    made: bool
    checks: tuple[ProjectCheck, ...]
    print_time_s: float | None
    rehearsal_speed: float
    print_state: str
    has_report: bool
    reasons: tuple[str, ...]
    passed: bool | None


class ProjectService:
    """The guided way; any thread may call.

    Parameters
    ----------
    core : Core
    design : DesignService
        Recipes and their runs.
    """

    def __init__(self, core: Core, design: DesignService) -> None:
        self._workspace, self._events, self._design = core.workspace, core.events, design
        self._sketches = SketchProcess()

    async def close(self) -> None:
        """End the process that sketches."""
        await self._sketches.close()

    def projects(self) -> list[ProjectRow]:
        """All projects, the one changed last first."""
        rows = [self._row(name) for name in self._design.recipes.names()]
        return sorted(rows, key=lambda row: -row.modified)

    def project(self, name: str) -> Project:
        """One project.

        Raises
        ------
        NotFoundError
        """
        text = self._design.recipes.read(name).text
        checked = self._design.recipes.check(text)
        run = self._design.runs.progress(name)
        folder = self._workspace.run(name)
        made = self._is_made(text, run, folder)
        stages = Manifest.load(folder).stages if folder.is_dir() else {}
        checks = _checks(folder, stages) if made else ()
        print_state = self._design.runs.print_state(name) if made else ""
        judged, report = self._judged(name, text, print_state) if made else ("", None)
        rehearsal = self._design.runs.progress(name + REHEARSAL)
        time_s = stages["dry run"].summary.get("print_time_s") if made else None
        return Project(
            name=name,
            step=_step(made, checks, print_state, report),
            problems=tuple(one.message for one in checked.problems),
            sliders=sliders(checked),
            run=rehearsal if rehearsal.going_on else run,
            judged=judged,
            made=made,
            checks=tuple(sorted(checks, key=lambda one: (one.passed, not one.refuses))),
            print_time_s=time_s,
            rehearsal_speed=min(max(round((time_s or 0.0) / LONGEST_REHEARSAL_S), 1), MAX_SPEED),
            print_state=print_state,
            has_report=report is not None,
            reasons=tuple(report["verdict"].get("reasons", ())) if report else (),
            passed=bool(report["verdict"]["passed"]) if report else None,
        )

    def begin(self, name: str, file: str, unit: LengthUnit) -> Project:
        """Begin a project with a file beside the recipes.

        A mesh becomes a tissue in which a tree is grown; a network is written as it is.

        Parameters
        ----------
        name : str
        file : str
        unit : LengthUnit
            Of the file, where its format doesn't say it.

        Raises
        ------
        BadRequestError, ConflictError
        """
        checked_name(name)
        suffix = Path(file).suffix.lower()
        mesh = suffix in (".stl", ".obj", ".ply", ".3mf")
        recipe: dict[str, Any] = {"schema": 1, "name": name, "seed": 1}
        if mesh:
            recipe["tissue"] = {"mesh": file, "unit": unit}
            recipe["vasculature"] = {"grow": "tree", "terminals": 100, "printable": True}
        else:
            said = {"unit": unit} if suffix in (".csv", ".vtp", ".swc") else {}
            recipe["vasculature"] = {"network": file} | said
        recipe |= _EMBEDDED
        text = "# Begun on the page; every key is explained in docs/recipe.md.\n"
        text += yaml.safe_dump(recipe, sort_keys=False)
        checked = self._design.recipes.check(text)
        if checked.problems:
            raise BadRequestError("\n".join(one.message for one in checked.problems))
        if name in self._design.recipes.names():
            raise ConflictError(f"there is a recipe {name!r} already; give another name")
        self._design.recipes.write(name, text)
        return self.project(name)

    async def sketch(
        self, name: str, values: dict[str, float], known: str, gone: Gone
    ) -> dict[str, Any]:
        """The vessels that a recipe would give with other values; nothing is kept.

        Parameters
        ----------
        name : str
        values : dict
            Paths of sliders to their values.
        known : str
            Tag of the tissue's outline that the browser has.
        gone : coroutine function
            Whether who asked has left meanwhile.

        Raises
        ------
        BadRequestError
            When the recipe can't be used with them.
        ConflictError
            When the vessels can't be grown.
        """
        checked = self._design.recipes.check(_changed(self._design.recipes.read(name).text, values))
        if checked.recipe is None:
            raise BadRequestError("\n".join(one.message for one in checked.problems))
        recipe = checked.recipe.model_dump(mode="json", by_alias=True)
        print_ = self._events.latest.get("print", {"ended": True})
        folder = self._design.recipes.folder
        return await self._sketches.sketch(recipe, folder, known, not print_["ended"], gone)

    def change(self, name: str, values: dict[str, float]) -> Project:
        """Write values of sliders into the recipe.

        Raises
        ------
        NotFoundError, BadRequestError, ConflictError
        """
        before = self._design.recipes.read(name)
        text = _changed(before.text, values)
        checked = self._design.recipes.check(text)
        if checked.recipe is None:
            raise BadRequestError("\n".join(one.message for one in checked.problems))
        self._design.recipes.write(name, text, before.version)
        return self.project(name)

    def rehearse(self, name: str, speed: float) -> RunProgress:
        """Print the design on the simulated printer, scan it by the simulated scanner, judge it.

        Parameters
        ----------
        name : str
        speed : float
            Times real time.

        Raises
        ------
        ConflictError
            Before the design is made, or while a run or print of it goes on.
        """
        project = self.project(name)
        if not project.made:
            raise ConflictError(f"the design of {name!r} isn't made as the recipe stands; make it")
        return self._design.runs.rehearse(name, speed)

    # --- between -------------------------------------------------------------------------------

    def _row(self, name: str) -> ProjectRow:
        folder, run = self._workspace.run(name), self._design.runs.progress(name)
        text = self._design.recipes.read(name).text
        made = self._is_made(text, run, folder)
        state = self._design.runs.print_state(name) if made else ""
        _, report = self._judged(name, text, state) if made else ("", None)
        changed = max(
            path.stat().st_mtime for path in (self._workspace.recipe(name), folder) if path.exists()
        )
        return ProjectRow(name, changed, _step(made, (), state, report))

    def _judged(self, name: str, text: str, print_state: str) -> tuple[str, dict[str, Any] | None]:
        """Return the run that was judged, and its report: of the real print before a rehearsal."""
        report = _report(self._workspace.run(name)) if print_state in ENDED else None
        if report is not None or print_state == "done":
            return (name if report else ""), report
        rehearsal = self._design.runs.rehearsal(name)
        if not self._is_made(text, self._design.runs.progress(rehearsal.name), rehearsal):
            return "", None
        report = _report(rehearsal)
        return (rehearsal.name if report else ""), report

    def _is_made(self, text: str, run: RunProgress, folder: Path) -> bool:
        """Whether the run's G-code is there, was checked, and is of the recipe as it stands."""
        try:
            same = (folder / RECIPE).read_text(encoding="utf-8") == text
        except OSError:
            return False
        if not same or not (folder / GCODE).is_file():
            return False
        stages = {one.name: one.state for one in run.stages}
        checked = "dry run" in Manifest.load(folder).stages
        return checked and all(stages.get(one, "done") == "done" for one in JOB_NAMES)


def _changed(text: str, values: dict[str, float]) -> str:
    data = read_text(text)
    for path, value in values.items():
        _set(data, path.split("."), value)
    return rewrite_yaml(text, data)


def _set(data: Any, keys: list[str], value: float) -> None:
    """Set one value of nested mappings and lists.

    Raises
    ------
    BadRequestError
        When there is no such place.
    """
    *way, last = keys
    try:
        for key in way:
            data = data[int(key)] if isinstance(data, list) else data.setdefault(key, {})
        place: Any = int(last) if isinstance(data, list) else last
        before = data[place] if isinstance(data, list) else data.get(place)
        data[place] = int(value) if isinstance(before, int) and value == int(value) else value
    except (AttributeError, IndexError, TypeError, ValueError) as exc:
        raise BadRequestError(f"the recipe has no place {'.'.join(keys)[:80]!r}") from exc


# How a file that a user brings is printed, until somebody says otherwise.
_EMBEDDED: Final[dict[str, Any]] = {
    "flow": {"viscosity_mpa_s": 1.0, "inlet_flow_ml_min": 1.0},
    "toolpath": {"method": "embedded", "needle": "30g_50mm", "overlap_radii": 0.0},
    "printer": {
        "profile": "generic_marlin",
        "port": "simulated",
        "syringe": "hamilton_2_5ml",
        "ink": "gelatin_sacrificial",
        "bath": "cell_matrix",
    },
}


@cache
def gallery() -> tuple[GalleryEntry, ...]:
    """Examples with pictures; those that aren't installed are left out."""
    path = Path(__file__).with_name("gallery.yaml")
    entries = [GalleryEntry(**one) for one in yaml.safe_load(path.read_text(encoding="utf-8"))]
    return tuple(one for one in entries if (EXAMPLES / f"{one.example}.yaml").is_file())


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
    if checked.recipe is None:
        return ()
    data = checked.recipe.model_dump(mode="json")
    grown = "terminals" in data["vasculature"] and data["vasculature"]["terminals"] is not None
    found = []
    for path, label, unit, hint, least, most, step in _SLIDERS:
        value = _value(data, path.split("."))
        if grown and value is not None:
            least, most = min(least, value), max(most, value)
            found.append(Slider(path, label, unit, hint, value, least, most, step))
    return tuple(found)


def _value(data: Any, keys: list[str]) -> float | None:
    for key in keys:
        if isinstance(data, list):
            data = data[int(key)] if int(key) < len(data) else None
        else:
            data = data.get(key) if isinstance(data, dict) else None
    return data if isinstance(data, int | float) else None


def _step(made: bool, checks: tuple[ProjectCheck, ...], print_state: str, report: Any) -> Step:
    if not made:
        return "shape"
    if report is not None:
        return "done"
    if print_state == "done":
        return "judge"
    refused = any(not one.passed and one.refuses for one in checks)
    return "check" if refused else "print"


def _checks(folder: Path, stages: Any) -> tuple[ProjectCheck, ...]:
    """What dry run and lumens say of a design."""
    found = []
    for one in stages["dry run"].summary.get("checks", ()):
        counted = one["value"] or one["limit"] or one["unit"]  # else it is a question to a person
        found.append(
            ProjectCheck(
                check=one["check"],
                passed=one["passed"],
                refuses=one["weight"] == "refuses",
                value=one["value"] if counted else None,
                limit=one["limit"] if counted else None,
                unit=one["unit"],
                place=one["place"],
                remedy="" if one["passed"] else one["remedy"],
            )
        )
    lumens = stages["lumens"].summary if "lumens" in stages else {}
    if lumens.get("checked"):
        counts = lumens["summary"]
        found.append(
            ProjectCheck(
                check="lumens open, and without leaks, by the G-code",
                passed=bool(lumens["passed"]),
                refuses=False,
                value=float(counts["lumens"] - counts["closed"]),
                limit=float(counts["lumens"]),
                unit="open",
                remedy="" if lumens["passed"] else "take thinner lines or wider vessels",
            )
        )
    return tuple(found)


def _report(folder: Path) -> dict[str, Any] | None:
    """A run's report, if it is newer than its print."""
    path = folder / "report.json"
    try:
        if path.stat().st_mtime < (folder / GCODE).stat().st_mtime:
            return None
        report: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return report if "verdict" in report else None
