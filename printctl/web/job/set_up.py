"""A job's set-up: from the form, its recipe and the printer; kept beside the job."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Final

from pydantic import BaseModel, ConfigDict, Field

from design.files import write_text
from firmware_profiles import Facts, Printer, ProfileError, load
from firmware_profiles.tools import THINNEST_BORE
from gcode.user_files import read_gcode_path
from printctl.checks.set_up import (
    NONE,
    OPTION_KEYS,
    Budget,
    ProfileNames,
    SetUp,
    set_up,
    shortest_budget,
)
from printctl.errors import PrintctlError
from printctl.pipeline.checked_order import OrderCare, told_start
from printctl.recipe.model import Recipe
from printctl.recipe.sections.making import CarePart
from printctl.run_folder.manifest import Manifest
from printctl.web.profile_store import PARTS
from printctl.web.workspace import Workspace

PAGE_KEYS: Final = replace(OPTION_KEYS, reload="allow changes of syringe")
FARTHEST_MM: Final = 5000.0
"""No printer's tip stands farther from its origin."""
Millimetre = Annotated[float, Field(ge=-FARTHEST_MM, le=FARTHEST_MM, allow_inf_nan=False)]
Place = tuple[Millimetre, Millimetre, Millimetre]
Profile = Annotated[str, Field(max_length=300)]
PROFILES: Final[dict[str, type[Facts]]] = {"printer": Printer, **PARTS}
"""Fields of a set-up that name profiles, and of what."""


class JobSetUp(BaseModel):
    """The machine, what is mounted on it, and how the print is watched over.

    Needle, bath and dish are ``none`` where a person said that there is none.
    Of several heads ``syringe``, ``ink`` and ``needle`` may be one for each: ``left,right``.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    printer: Profile = Field(default="generic_marlin", description="Printer profile.")
    syringe: Profile = Field(default="hamilton_1ml", description="Syringe profile.")
    ink: Profile = Field(default="collagen_fresh", description="Ink profile.")
    needle: Profile = Field(default="", description="Needle profile; empty where nobody said.")
    bath: Profile = Field(default="", description="Bath profile; empty where nobody said.")
    dish: Profile = Field(default="", description="Dish profile; empty where nobody said.")
    dish_centre_mm: tuple[Millimetre, Millimetre] | None = Field(
        default=None, description="x, y in the printer's frame; below the start if not."
    )
    bath_depth_mm: Annotated[float, Field(gt=0, le=500)] | None = Field(
        default=None, description="How high the dish is filled."
    )
    start_mm: Place = Field(
        default=(0.0, 0.0, 0.0), description="Where the tip stands before the first line."
    )
    accept_crossings: bool = Field(
        default=False,
        description="Print although the needle's shaft passes through written vessels: for the "
        "next print alone; the journal keeps it.",
    )
    thinnest_bore: Annotated[float, Field(ge=0.05, le=2)] = Field(
        default=THINNEST_BORE,
        description="Narrowest line that may be written, in bores of the needle.",
    )
    care: CarePart = CarePart()

    @property
    def profiles(self) -> dict[str, list[str]]:
        """Names that are given of each sort of profile, of several heads several."""
        return {
            part: [
                name
                for name in getattr(self, part).split(",")
                if name and not (name == NONE and part in ("needle", "bath", "dish"))
            ]
            for part in PROFILES
        }

    def mounted(self) -> SetUp:
        """Load the profiles that it names."""
        placed = self.dish != NONE and self.dish_centre_mm is not None
        centre = "{!r},{!r}".format(*self.dish_centre_mm or ()) if placed else None
        given = ProfileNames(
            self.needle or None,
            self.bath or None,
            self.dish or None,
            centre,
            self.bath_depth_mm if self.dish != NONE else None,
            self.thinnest_bore,
        )
        printer = load(Printer, self.printer)
        return set_up(printer, self.syringe, self.ink, self.start_mm, given, PAGE_KEYS)

    @property
    def order_care(self) -> OrderCare:
        """How its job is printed; what is on the machine is compared when a print starts."""
        return OrderCare(self.care, accept_crossings=self.accept_crossings)

    def budget(self, mounted: SetUp) -> Budget | None:
        """How long the cells have; of several inks those that have least time."""
        care = self.care
        return shortest_budget(mounted.inks, care.viability_min, care.viability_source)


def recipe_of(folder: Path) -> Recipe | None:
    """The recipe that a run folder was made from; None where it can't be told."""
    data = Manifest.load(folder).facts.get("recipe")
    if not isinstance(data, dict):
        return None
    try:
        return Recipe.model_validate(data)
    except (PrintctlError, ValueError):
        return None


def _set_up_of_recipe(recipe: Recipe) -> JobSetUp:
    """Return what a recipe says of the machine and of what is mounted."""
    part, heads, needle = recipe.printer, recipe.printer.heads, recipe.toolpath.needle
    return JobSetUp(
        printer=part.profile,
        syringe=",".join(one.syringe for one in heads) or part.syringe,
        ink=",".join(one.ink for one in heads) or part.ink,
        needle=",".join(one.needle or needle for one in heads) or needle,
        bath=part.bath,
        dish=part.dish or "",
        dish_centre_mm=part.dish_centre_mm,
        bath_depth_mm=part.bath_depth_mm,
        thinnest_bore=recipe.toolpath.thinnest_bore,
        care=part.care,
    )


@lru_cache(maxsize=256)
def _declared(path: Path, printer: str, size: int, changed_ns: int) -> Place | None:
    try:
        start = told_start(read_gcode_path(path), path.name, load(Printer, printer))
    except (OSError, ProfileError):
        return None
    if start is not None and max(map(abs, start)) > FARTHEST_MM:  # its checks say that it is wrong
        return None
    return start


def read_declared(path: Path, printer: str) -> Place | None:
    """Read where a job says that the tip stands, mm; None where it doesn't, or can't be read.

    The file is read once for each printer profile, and again when its size or time of change is
    another.
    """
    stat = path.stat()
    return _declared(path, printer, stat.st_size, stat.st_mtime_ns)


_PRINTED: Final = "set_up.json"
"""In a print's folder: what it was started with."""


class SetUps:
    """Set-ups of a workspace's jobs."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace

    def of(self, job: str) -> JobSetUp:
        """As it was given for this job last, else by its recipe; the file isn't read for its start.

        WebError when there is no such job.
        """
        if (kept := _read(self._kept(job))) is not None:
            return kept
        folder = self._workspace.job_file(job).parent
        recipe = recipe_of(folder) if job.startswith("run~") else None
        return JobSetUp() if recipe is None else _set_up_of_recipe(recipe)

    def kept(self, job: str) -> bool:
        """Whether one was given for this job."""
        return self._kept(job).is_file()

    def keep(self, job: str, set_up: JobSetUp) -> None:
        """Remember it for the next visit."""
        write_text(self._kept(job), set_up.model_dump_json() + "\n")

    def printed(self, folder: Path) -> JobSetUp | None:
        """What the print in a folder was started with; None where the page didn't start it."""
        return _read(folder / _PRINTED)

    def keep_printed(self, folder: Path, set_up: JobSetUp) -> None:
        """Write down what a print is started with."""
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / _PRINTED, set_up.model_dump_json(indent=1) + "\n")

    def _kept(self, job: str) -> Path:
        self._workspace.job_file(job)  # refuses names that would lead elsewhere
        return self._workspace.private / "set_ups" / f"{job}.json"


def _read(path: Path) -> JobSetUp | None:
    if not path.is_file():
        return None
    return JobSetUp.model_validate_json(path.read_text(encoding="utf-8"))
