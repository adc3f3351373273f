"""Mounted parts of each printer, and the ink left in its syringe, kept between prints.

One file per printer in the user's data folder, which the command line, the page and the machine's
processes share. A simulated station has a file of its own, in its folder.
"""

from __future__ import annotations

import hashlib
import json
import logging
import math
from collections.abc import Collection
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from design.files import write_text
from firmware_profiles import Bath, Dish, Facts, Ink, Needle, Printer, Syringe, load
from printctl.machine.errors import JournalError, Refused
from printctl.machine.job.job import Job
from printctl.machine.job.syringes import plunger_travel, usable_mm
from printctl.machine.records.folders import data_folder
from printctl.machine.records.record import JOURNAL
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import Status

PARTS: Final[dict[str, type[Facts]]] = {
    "syringe": Syringe,
    "needle": Needle,
    "ink": Ink,
    "bath": Bath,
    "dish": Dish,
}
"""Parts that can be mounted on a printer, and their profiles."""
_SIMULATED_FILE: Final = "mounted.json"

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class MountedParts:
    """What the user said is on the printer; nobody can check it.

    Attributes
    ----------
    needle, syringe, ink, dish, bath : str
        Profiles, by name or path; empty for nothing there, or unknown.
    dish_centre_mm : (x, y) or None, mm
        Printer's frame, as the printer counts now.
    floor_mm : float or None, mm
        Height of the tip when it touches the dish's floor; None until it was touched off.
    bath_level_mm : float or None, mm
        Height of the bath's surface, printer's frame; None where unknown.
    bath_depth_mm : float or None, mm
        How high the dish is filled; None where unknown.
    """

    needle: str = ""
    syringe: str = ""
    ink: str = ""
    dish: str = ""
    bath: str = ""
    dish_centre_mm: tuple[float, float] | None = None
    floor_mm: float | None = None
    bath_level_mm: float | None = None
    bath_depth_mm: float | None = None

    @property
    def touch_off_due(self) -> bool:
        """Whether a needle is above a dish whose floor it hasn't touched."""
        return bool(self.needle and self.dish) and self.floor_mm is None

    @property
    def depth_mm(self) -> float | None:
        """Depth of the bath: as touched off, else as given."""
        if self.bath_level_mm is None or self.floor_mm is None:
            return self.bath_depth_mm
        return self.bath_level_mm - self.floor_mm

    def without_heights(self) -> MountedParts:
        """Return what holds even when the printer has lost its count."""
        return replace(self, floor_mm=None, bath_level_mm=None, bath_depth_mm=self.depth_mm)

    @staticmethod
    def from_dict(data: dict[str, Any]) -> MountedParts:
        """Read a JSON object; keys of later versions are ignored."""
        known = {name: data[name] for name in MountedParts.__dataclass_fields__ if name in data}
        centre = known.get("dish_centre_mm")
        return MountedParts(
            **{**known, "dish_centre_mm": None if centre is None else tuple(centre)}
        )


@dataclass(frozen=True)
class Mounting:
    """What is mounted on a printer, and what was used up.

    Attributes
    ----------
    printer : str
        Profile, by shipped name or resolved path.
    parts : MountedParts
    plunger_mm : float or None, mm
        Travel of the syringe that is used up; None where unknown.
    part_in_dish : bool
        Whether something was printed into the dish.
    holder : str
        Folder of the last station or print of the printer, which may still be at work.
    """

    printer: str = ""
    parts: MountedParts = field(default_factory=MountedParts)
    plunger_mm: float | None = None
    part_in_dish: bool = False
    holder: str = ""

    def left_ul(self, printer: Printer) -> float | None:
        """Return the ink that the syringe can still push, µL; None where unknown."""
        if self.plunger_mm is None or not self.parts.syringe:
            return None
        syringe = load(Syringe, self.parts.syringe)
        return max(0.0, usable_mm(syringe, printer) - self.plunger_mm) * syringe.area_mm2

    def reserved_ul(self, printer: Printer) -> float | None:
        """Return the ink in the syringe that can't be pushed, µL: dead volume, beyond the drive."""
        left = self.left_ul(printer)
        if left is None or self.plunger_mm is None:
            return None
        syringe = load(Syringe, self.parts.syringe)
        return max(0.0, syringe.volume_ul - self.plunger_mm * syringe.area_mm2 - left)


def refuse_impossible(
    printer: Printer, parts: MountedParts, plunger_mm: float | None, given: Collection[str]
) -> None:
    """Raise `Refused` for a ``given`` length that the machine, dish or syringe doesn't have."""
    if "dish_centre_mm" in given and parts.dish_centre_mm is not None:
        x, y = parts.dish_centre_mm
        spans = (printer.x_mm, printer.y_mm)
        if not all(one.low <= mm <= one.high for one, mm in zip(spans, (x, y), strict=True)):
            travel = " and ".join(
                f"{axis} {one.low:g} to {one.high:g} mm"
                for axis, one in zip("XY", spans, strict=True)
            )
            raise Refused(
                f"dish centre {x:g},{y:g} mm is outside the travel of {printer.name}, {travel} "
                "(x_mm, y_mm); give it in the printer's frame"
            )
    asks_depth = not {"bath_depth_mm", "bath_level_mm", "floor_mm"}.isdisjoint(given)
    depth_mm, wall_mm = parts.depth_mm if asks_depth else None, math.inf
    if parts.dish:
        wall_mm = load(Dish, parts.dish).wall_mm
    elif "bath_depth_mm" in given and depth_mm is not None:
        raise Refused(
            f"bath depth {depth_mm:g} mm belongs to a dish, and no dish is mounted; name the dish "
            "as well"
        )
    if depth_mm is not None and not 0 < depth_mm <= wall_mm:
        raise Refused(
            f"bath depth {depth_mm:g} mm isn't between 0 and {wall_mm:g} mm, the wall of "
            f"{parts.dish} (wall_mm); correct the depth or the dish, or touch off again"
        )
    if "plunger_mm" in given and plunger_mm is not None and parts.syringe:
        syringe = load(Syringe, parts.syringe)
        most_mm = syringe.volume_ul / syringe.area_mm2
        if not 0 <= plunger_mm <= most_mm * (1 + 1e-9):
            raise Refused(
                f"plunger travel {plunger_mm:g} mm isn't between 0 and {most_mm:.1f} mm, which "
                f"empties {syringe.name} (volume_ul, inner_mm)"
            )


def as_kept(profile: str) -> str:
    """Return a profile's name as it holds in any working folder: a file's path, resolved."""
    return str(Path(profile).resolve()) if profile.endswith((".yaml", ".yml")) else profile


def mounted_folder() -> Path:
    """Folder of what is mounted, and of the files that were confirmed for it."""
    return data_folder() / "mounted"


def mounting_file(printer: str, simulated_in: Path | None = None) -> Path:
    """Path of a printer's file; a simulated station's is in its folder."""
    if simulated_in is not None:
        return simulated_in / _SIMULATED_FILE
    return mounted_folder() / file_name(printer)


def file_name(printer: str) -> str:
    """Name of a file that is kept for a printer."""
    name = as_kept(printer)
    if name.endswith((".yaml", ".yml")):
        name = f"{Path(name).stem}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"
    return f"{name}.json"


def load_mounting(printer: str, simulated_in: Path | None = None) -> Mounting:
    """Return what is kept of a printer; nothing is known where no file is, or it can't be read."""
    key = as_kept(printer)
    kept = _read(mounting_file(printer, simulated_in))
    return kept if kept is not None and kept.printer == key else Mounting(key)


def _read(path: Path) -> Mounting | None:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        return Mounting(**{**data, "parts": MountedParts.from_dict(data["parts"])})
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        log.exception("%s can't be read; what is mounted counts as unknown", path)
        return None


def save_mounting(kept: Mounting, simulated_in: Path | None = None) -> None:
    """Write what is known of a printer; raises `OSError`."""
    data = asdict(replace(kept, parts=kept.parts.without_heights()))
    text = json.dumps(data, indent=1, allow_nan=False) + "\n"
    write_text(mounting_file(kept.printer, simulated_in), text)


def all_mountings() -> list[Mounting]:
    """Return what is known of every printer that something was mounted on."""
    every = (_read(path) for path in sorted(mounted_folder().glob("*.json")))
    return [one for one in every if one is not None]


def after_print(
    before: Mounting, printer: Printer, job: Job, folder: Path, status: Status
) -> Mounting:
    """Return what a print leaves behind.

    Parameters
    ----------
    before : Mounting
        As the print began.
    job : Job
        With what was inserted.
    folder : Path
        Of its journal, which names a syringe that was put in meanwhile.
    status : Status
        How it ended.
    """
    done = status.lines_done
    travel = plunger_travel(job.lines[:done])
    made = min(status.lines_executed, done)
    syringe, used = before.parts.syringe, before.plunger_mm
    try:
        filling = read_journal(folder / JOURNAL).filled.get(None)
    except JournalError:
        filling, used = None, None
    if filling is not None:
        syringe = filling.name or syringe
        used = filling.used_mm + travel[made] - travel[min(filling.done, made)]
    elif used is not None:  # without the relief of a stop: so much is left at least
        used += travel[made]
    wrote = max(travel) > 0 or any(line.startswith(b"M106") for line in job.lines[:done])
    return replace(
        before,
        parts=replace(before.parts, syringe=syringe),
        plunger_mm=None if printer.heads or printer.airs else used,
        part_in_dish=before.part_in_dish or bool(wrote and before.parts.dish),
    )
