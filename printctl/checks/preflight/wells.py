"""Checks of a plate job: map of wells, walls, rims, and equality of wells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.toolpath.gcode.table import decimals_for
from firmware_profiles import Dish, Needle, Printer
from gcode.dry_run.run import DryRun
from gcode.program.gcode import Program
from gcode.program.modal import MOVE
from kernels.arrays import FloatArray, IntArray
from printctl.checks.kinds import Kind
from printctl.checks.preflight.dish import hub_gap, hub_remedy, tips_of, wall_gap
from printctl.checks.preflight.mounted import longer_needle
from printctl.checks.set_up import WALL_CLEARANCE_MM, Check, PlacedDish, none_of


def well_arrays(
    names: Sequence[str],
    centre_mm: FloatArray,
    dish: Dish,
    floor_mm: float,
    bath_mm: float | None,
    safe_z_mm: float,
) -> dict[str, NDArray[Any]]:
    """Return the map's arrays of all wells in one frame; parameters as in `Wells`."""
    return {
        "plate_wells": np.array(list(names)),
        "plate_centre_mm": np.asarray(centre_mm, dtype=np.float64),
        "plate_shape": np.array(dish.shape),
        "plate_name": np.array(dish.name),
        "plate_inner_mm": np.array([dish.inner_x_mm, dish.inner_y_mm, dish.wall_mm]),
        "plate_floor_mm": np.array(floor_mm),
        "plate_bath_mm": np.array(np.nan if bath_mm is None else bath_mm),
        "plate_safe_z_mm": np.array(safe_z_mm),
    }


def read_wells(path: Path, line: NDArray[np.int64], volume_ul: FloatArray) -> Wells | None:
    """Wells of a job, and what is written into each; None where the map is of no plate.

    Parameters
    ----------
    path : Path
        The map.
    line : (rows,) int64
        Line of the file that each row of its program is on, from 1.
    volume_ul : (rows,) float64, µL
        What comes out in each.
    """
    if not path.is_file():
        return None
    with np.load(path, allow_pickle=False) as arrays_file:
        if "plate_wells" not in arrays_file.files or len(arrays_file["well"]) < line.max(initial=0):
            return None
        data = {name: arrays_file[name] for name in arrays_file.files}
    well = data["well"][line - 1]
    ink = {str(name): float(volume_ul[well == k].sum()) for k, name in enumerate(data["wells"])}
    return _wells(data, ink)


def _wells(data: Mapping[str, NDArray[Any]], ink_ul: Mapping[str, float]) -> Wells:
    x, y, wall = data["plate_inner_mm"].tolist()
    bath = float(data["plate_bath_mm"])
    dish = Dish.model_validate(
        {
            "name": str(data["plate_name"]),
            "source": "map of the job",
            "licence": "facts, no licence needed",
            "shape": str(data["plate_shape"]),
            "inner_x_mm": x,
            "inner_y_mm": y,
            "wall_mm": wall,
        }
    )
    return Wells(
        [str(name) for name in data["plate_wells"]],
        data["plate_centre_mm"],
        dish,
        float(data["plate_floor_mm"]),
        None if np.isnan(bath) else bath,
        float(data["plate_safe_z_mm"]),
        ink_ul,
    )


_ROUNDINGS: Final = 2.5
"""Units of a text's last decimal by which a way may differ: either end, in either file."""


def compare_well_moves(
    well: str,
    plate: tuple[Program, NDArray[np.bool_]],
    alone: tuple[Program, NDArray[np.bool_]],
    moved_mm: FloatArray,
    printer: Printer,
) -> Check:
    """Compare the moves of some lines of one job with those of another.

    Parameters
    ----------
    well : str
    plate, alone : Program and (rows,) bool
        Each with the rows that are the part's own.
    moved_mm : (3,) float64, mm
        From the job by itself to the plate's.
    printer : Printer
        Which says how many decimals a file has.
    """
    digits = decimals_for(printer)
    allowed = _ROUNDINGS * 10.0 ** -min(digits.x, digits.y, digits.z)
    here, there = _moves(*plate), _moves(*alone)
    same = len(here[0]) == len(there[0])
    off = float(np.abs(here[0] - there[0] - moved_mm).max(initial=0.0)) if same else np.inf
    pushed = float(np.abs(here[1] - there[1]).max(initial=0.0)) if same else np.inf
    differences = {
        "mm": (off, allowed),
        "mm of the plunger": (pushed, _ROUNDINGS * 10.0**-digits.e),
    }
    if not same:
        differences = {"moves": (float(abs(len(here[0]) - len(there[0]))), 0.0)}
    unit, (value, limit) = max(differences.items(), key=lambda one: one[1][0] - one[1][1])
    return Check(
        Kind.WELL_MOVES,
        "wells vs. the checked single part",
        value,
        limit,
        unit,
        value <= limit,
        f"well {well}",
        "the plate's job differs from the checked part (a bug in printctl): don't print it, and "
        "report it with the recipe",
    )


def _moves(program: Program, rows: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    chosen = rows & (program.kind == MOVE)
    return program.target[chosen, :3], program.pushed[chosen]


_TINY_MM: Final = 1e-6


@dataclass(frozen=True)
class Wells:
    """The wells of a plate as they stand.

    Attributes
    ----------
    names : sequence of str
        All that the plate has.
    centre_mm : (w, 2) float64, mm
        Printer's frame.
    dish : Dish
        Any of them.
    floor_mm : float, mm
    bath_mm : float or None, mm
    safe_z_mm : float, mm
        From where a tip is clear of every rim.
    ink_ul : mapping of str to float, µL
        What is written into each well that is printed in.
    """

    names: Sequence[str]
    centre_mm: FloatArray
    dish: Dish
    floor_mm: float
    bath_mm: float | None
    safe_z_mm: float
    ink_ul: Mapping[str, float]

    def standing(self, number: int) -> PlacedDish:
        """One well as a dish."""
        x, y = self.centre_mm[number].tolist()
        return PlacedDish(self.dish, (x, y), self.floor_mm, self.bath_mm)

    def nearest(self, tips: FloatArray) -> IntArray:
        """The well whose middle is nearest to each place, (…,)."""
        off = tips[..., None, :2] - self.centre_mm
        return np.asarray((off**2).sum(axis=-1).argmin(axis=-1))


def well_checks(run: DryRun, wells: Wells, needle: Needle) -> list[Check]:
    """Every well that the needle goes into, and every way below the plate's rims.

    Of each question the answers that don't pass stand one by one, each with its well; where all
    pass, the one that comes nearest to its limit.
    """
    tips, moves = tips_of(run), run.program.kind == MOVE
    low = moves & (tips[:, :, 2].min(axis=1) < wells.safe_z_mm - _TINY_MM)
    near = wells.nearest(tips)
    checks = [_crossing(run, wells, tips, low & (near[:, 0] != near[:, 1]))]
    asked = [
        _of_well(
            run, wells, needle, number, low & (near == number).any(axis=1), near[:, 1] == number
        )
        for number in np.unique(near[low]).tolist()
    ]
    for kind in dict.fromkeys(check.kind for group in asked for check in group):
        checks += _worst([check for group in asked for check in group if check.kind == kind])
    return checks


def _worst(checks: Sequence[Check]) -> list[Check]:
    failed = [check for check in checks if not check.passed]
    return failed or [min(checks, key=_room)]


def _room(check: Check) -> float:
    return abs(check.value - check.limit)


def _crossing(run: DryRun, wells: Wells, tips: FloatArray, across: NDArray[np.bool_]) -> Check:
    """Ways from one well to another must be above the rims."""
    height = np.where(across, tips[:, :, 2].min(axis=1), np.inf)
    row = int(height.argmin()) if len(height) else -1
    crosses = row >= 0 and bool(across.any())
    return Check(
        Kind.WELL_RIMS,
        "travel between wells vs. plate rim",
        float(height[row]) if crosses else wells.safe_z_mm,
        wells.safe_z_mm,
        "mm",
        not crosses,
        f"line {int(run.program.line[row])}" if crosses else "",
        "the needle would hit the well walls; raise the travel above the plate (height_mm of the "
        "plate, and its clearance)",
    )


def _of_well(
    run: DryRun,
    wells: Wells,
    needle: Needle,
    number: int,
    rows: NDArray[np.bool_],
    ends: NDArray[np.bool_],
) -> list[Check]:
    """Checks of one well.

    ``rows`` are the moves that begin or end at it below the rims, ``ends`` all that end at it.
    """
    name, standing, tips = wells.names[number], wells.standing(number), tips_of(run)
    if name not in wells.ink_ul:
        line = int(run.program.line[np.flatnonzero(rows)[0]])
        return [
            none_of(
                Kind.WELL_ENTERED,
                "wells entered without printing",
                1,
                f"well {name}, line {line}",
                "the needle goes down where there is no part; check the plate position (a1_mm, "
                "turned_deg)",
            )
        ]
    at = _Well(run, name, rows, tips, ends)
    tall = replace(
        standing,
        dish=standing.dish.model_copy(update={"wall_mm": wells.safe_z_mm - wells.floor_mm}),
    )
    checks = [
        at.least(
            Kind.WALL,
            "needle to well wall",
            wall_gap(tips, rows, tall, needle.outer_mm),
            standing.dish.inner_x_mm / 2,
            f"the needle would hit the wall of {standing.dish.name}; use a plate with wider wells, "
            "or check the plate position (a1_mm, turned_deg)",
        ),
        at.least(
            Kind.HUB,
            "needle hub to well wall",
            hub_gap(tips, rows, standing, needle),
            standing.dish.inner_x_mm / 2,
            hub_remedy(needle, standing.dish),
        ),
    ]
    if standing.bath_mm is None:
        return checks
    return checks + _bath(at, standing, needle, wells.ink_ul[name])


@dataclass(frozen=True)
class _Well:
    run: DryRun
    name: str
    rows: NDArray[np.bool_]
    tips: FloatArray
    ends: NDArray[np.bool_]

    def place(self, row: int) -> str:
        return f"well {self.name}, line {int(self.run.program.line[row])}"

    def least(self, kind: Kind, check: str, gap: FloatArray, none: float, remedy: str) -> Check:
        """A least distance against the clearance; ``none`` where nothing comes below the rim."""
        row = int(gap.argmin())
        value = float(gap[row]) if np.isfinite(gap[row]) else none
        passed = value >= WALL_CLEARANCE_MM
        return Check(kind, check, value, WALL_CLEARANCE_MM, "mm", passed, self.place(row), remedy)


def _bath(at: _Well, standing: PlacedDish, needle: Needle, ink_ul: float) -> list[Check]:
    """Rise of the bath, its surface, and the hub above it."""
    surface = standing.floor_mm + (standing.bath_mm or 0.0)
    tips, dish = at.tips, standing.dish
    moved = np.linalg.norm(np.diff(tips, axis=1)[:, 0], axis=1) > 0
    written = (at.rows | at.ends) & at.run.doses & moved
    tops = np.where(written, tips[:, :, 2].max(axis=1), -np.inf)
    lows = np.where(at.rows, tips[:, :, 2].min(axis=1), np.inf)
    top, low = float(tops.max()), float(lows.min())
    risen = standing.risen_mm(needle, surface - low, ink_ul)
    return [
        Check(
            Kind.BATH_DEPTH,
            "well bath depth with ink and needle vs. rim",
            risen,
            dish.wall_mm,
            "mm",
            risen <= dish.wall_mm,
            f"well {at.name}, plate.bath_depth_mm",
            f"{dish.name} would overflow; fill less or use a plate with deeper wells",
        ),
        Check(
            Kind.BATH_SURFACE,
            "highest extrusion in a well vs. bath surface",
            top if written.any() else standing.floor_mm,
            surface,
            "mm",
            not written.any() or top <= surface + _TINY_MM,
            at.place(int(tops.argmax())),
            "it would print in air; fill the wells higher (plate.bath_depth_mm) or print a flatter "
            "part",
        ),
        Check(
            Kind.NEEDLE_LENGTH,
            "immersion depth in a well vs. needle length",
            surface - low,
            needle.length_mm,
            "mm",
            surface - low <= needle.length_mm + _TINY_MM,
            at.place(int(lows.argmin())),
            f"the hub of {needle.name} would dip into the bath; "
            f"{longer_needle(needle, surface - low)}, or fill less",
        ),
    ]
