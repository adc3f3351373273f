"""A job's set-up, and what a check of it is asked."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from firmware_profiles import Printer, load
from firmware_profiles.tools import THINNEST_BORE
from printctl.checks.set_up import Budget, ProfileNames, SetUp, budget_of, of_each, set_up
from printctl.machine.link.care import Care
from printctl.machine.printing import usable_mm
from printctl.recipe.making import CarePart
from printctl.web.errors import BadRequestError

Millimetre = Annotated[float, Field(ge=-5000, le=5000, allow_inf_nan=False)]
Profile = Annotated[str, Field(max_length=300)]


class JobSetUp(BaseModel):
    """The machine, what is mounted on it, and how the print is watched over.

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
    start_mm: tuple[Millimetre, Millimetre, Millimetre] = Field(
        default=(0.0, 0.0, 0.0), description="Where the tip stands before the first line."
    )
    accept_crossings: bool = Field(
        default=False,
        description="Print although the needle's shaft passes through written vessels; the "
        "journal keeps it.",
    )
    thinnest_bore: Annotated[float, Field(ge=0.05, le=2)] = Field(
        default=THINNEST_BORE,
        description="Narrowest line that may be written, in bores of the needle.",
    )
    care: CarePart = CarePart()

    def mounted(self) -> SetUp:
        """The profiles that it names.

        Raises
        ------
        ProfileError, UsageError
        """
        centre = None if self.dish_centre_mm is None else "{!r},{!r}".format(*self.dish_centre_mm)
        given = ProfileNames(
            self.needle or None,
            self.bath or None,
            self.dish or None,
            centre,
            self.bath_depth_mm,
            self.thinnest_bore,
        )
        return set_up(load(Printer, self.printer), self.syringe, self.ink, self.start_mm, given)

    def usable_mm(self, mounted: SetUp) -> list[float]:
        """Plunger travel of a full syringe of each head, mm."""
        printer = mounted.printer
        return [
            usable_mm(mounted.load_of(k).syringe, printer.of_head(k))
            for k in range(printer.head_count)
        ]

    def watched(self, mounted: SetUp) -> Care:
        """How the link watches over the print, before changes of syringe are planned."""
        names, usable = of_each(mounted.printer, self.syringe, "syringe"), self.usable_mm(mounted)
        several = len(names) > 1
        return Care(
            checkpoint_s=self.care.checkpoint_every_s,
            deadman_s=60.0 * self.care.deadman_min,
            deadman_stops=self.care.deadman_stops,
            silent_limit_s=self.care.silent_limit_s,
            noise_limit=self.care.noise_limit,
            syringe=names[0],
            capacity_mm=usable[0],
            head_syringes=tuple(names) if several else (),
            head_capacity_mm=tuple(usable) if several else (),
            start_mm=self.start_mm,
        )

    def budget(self, mounted: SetUp) -> Budget | None:
        """How long the cells have; of several inks those that have least time."""
        printer, care = mounted.printer, self.care
        inks = {one.ink.name: one.ink for one in map(mounted.load_of, range(printer.head_count))}
        budgets = [budget_of(i, care.viability_min, care.viability_source) for i in inks.values()]
        return min((one for one in budgets if one), key=lambda one: one.minutes, default=None)


def refuse_foreign_files(said: JobSetUp, root: Path, known: frozenset[str]) -> None:
    """Let profiles be shipped names, files of the workspace, or what the station itself uses.

    Raises
    ------
    BadRequestError
        For any other path: the page isn't for reading the machine's files.
    """
    for key in ("printer", "syringe", "ink", "needle", "bath", "dish"):
        for name in str(getattr(said, key)).split(","):
            plain = not any(mark in name for mark in "/\\")
            if plain or name in known or Path(name).resolve().is_relative_to(root.resolve()):
                continue
            raise BadRequestError(
                f"{key} {name[:80]!r} is a file outside the workspace {root}; give a shipped "
                "profile's name, or put the file into the workspace"
            )


@dataclass(frozen=True)
class Question:
    """Job and set-up to check.

    Attributes
    ----------
    gcode : Path
    set_up : JobSetUp
    table : Path
        Where the job's table goes.
    """

    gcode: Path
    set_up: JobSetUp
    table: Path

    def to_json(self) -> str:
        """One line of text that `from_json` reads."""
        set_up = self.set_up.model_dump(mode="json")
        return json.dumps({"gcode": str(self.gcode), "set_up": set_up, "table": str(self.table)})

    @staticmethod
    def from_json(text: str) -> Question:
        """Read `to_json`."""
        data = json.loads(text)
        set_up = JobSetUp.model_validate(data["set_up"])
        return Question(Path(data["gcode"]), set_up, Path(data["table"]))
