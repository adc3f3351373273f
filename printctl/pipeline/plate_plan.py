"""Plan a well plate: the wells in use, their contents and printing order; refuse misfits.

Goes in: a plate's profile and a recipe's section. Comes out: wells, their variants and order.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
from math import dist
from string import ascii_uppercase
from typing import Any, Final

from pydantic import ValidationError

from firmware_profiles import Dish, Ink, Plate, Printer
from firmware_profiles.errors import wording
from printctl.errors import RecipeError
from printctl.recipe import Recipe
from printctl.recipe.load import overridden
from printctl.recipe.sections.plate import PlatePart
from report.wording import label_and_unit

_NAME: Final = re.compile(r"([A-Za-z])0*([1-9]\d?)")


def expand(words: Sequence[str], plate: Plate, key: str) -> list[str]:
    """Wells that some words name, in their order.

    Parameters
    ----------
    words : sequence of str
    plate : Plate
    key : str
        Of the recipe, for messages.

    Raises
    ------
    RecipeError
        For what is no name, isn't on the plate or is named twice.
    """
    wells = [well for word in words for well in _of_word(word, plate, key)]
    twice = next((well for well in wells if wells.count(well) > 1), None)
    if twice:
        raise RecipeError(f"{key} names {twice} twice; a well holds one part, so name it once")
    return wells


def _of_word(word: str, plate: Plate, key: str) -> list[str]:
    first, _, last = word.partition("..")
    row, column = _place(first, plate, key)
    if not last:
        return [_name(row, column)]
    last_row, last_column = _place(last, plate, key)
    if last_row < row or last_column < column:
        raise RecipeError(
            f"{key}: {word} runs backwards; name the well behind on the left first, as in "
            f"{_name(min(row, last_row), min(column, last_column))}.."
            f"{_name(max(row, last_row), max(column, last_column))}"
        )
    return [_name(r, c) for r in range(row, last_row + 1) for c in range(column, last_column + 1)]


def _place(name: str, plate: Plate, key: str) -> tuple[int, int]:
    """Row and column from 0."""
    match = _NAME.fullmatch(name.strip())
    if match is None:
        raise RecipeError(
            f"{key}: {name!r} is no well; name wells like A1, or blocks of them like B1..B3"
        )
    row, column = ascii_uppercase.index(match[1].upper()), int(match[2]) - 1
    if row >= plate.rows or column >= plate.columns:
        raise RecipeError(
            f"{key}: well {name} isn't on {plate.name}, which has rows A to "
            f"{ascii_uppercase[plate.rows - 1]} and columns 1 to {plate.columns}"
        )
    return row, column


def _name(row: int, column: int) -> str:
    return f"{ascii_uppercase[row]}{column + 1}"


RIM_CLEARANCE_MM: Final = 2.0
"""Between the plate's highest rim and a tip that goes from well to well."""


@dataclass(frozen=True)
class WellDish:
    """One well as the dish in which a part stands.

    Attributes
    ----------
    well : str
    centre_mm : (x, y), mm
        Printer's frame.
    dish : Dish
    bath_mm : float or None, mm
        How high it is filled.
    safe_z_mm : float, mm
        From where a tip is clear of every rim of the plate.
    """

    well: str
    centre_mm: tuple[float, float]
    dish: Dish
    bath_mm: float | None
    safe_z_mm: float


@dataclass(frozen=True)
class StandingPlate:
    """A plate on the printer, the floors of its wells at the bottom of z.

    Attributes
    ----------
    plate : Plate
    middle_mm : (x, y), mm
        Of its outside, printer's frame.
    turned_deg : int
        Seen from above, against the clock.
    floor_mm : float, mm
    bath_mm : float or None, mm
        How high each well is filled.
    """

    plate: Plate
    middle_mm: tuple[float, float]
    turned_deg: int
    floor_mm: float
    bath_mm: float | None

    @property
    def rim_mm(self) -> float:
        """Height of the highest rim, printer's frame, mm.

        Wells' floors lie above the plate's own foot by a little that profiles don't tell: so it
        is told too high rather than too low.
        """
        return self.floor_mm + self.plate.height_mm

    @property
    def safe_z_mm(self) -> float:
        """From where a tip is clear of every rim, mm."""
        return self.rim_mm + RIM_CLEARANCE_MM

    @property
    def dish(self) -> Dish:
        """Any of its wells, as it stands."""
        return self.plate.dish(sideways=self.turned_deg in (90, 270))

    def turned(self, right: float, behind: float) -> tuple[float, float]:
        """A way on the plate as one on the printer, mm."""
        turn = math.radians(self.turned_deg)
        cos, sin = round(math.cos(turn)), round(math.sin(turn))
        return cos * right - sin * behind, sin * right + cos * behind

    def centre_mm(self, well: str) -> tuple[float, float]:
        """A well's centre in whole microns, printer's frame, mm."""
        x, y = self.turned(*self.plate.offset_mm(well))
        return round(self.middle_mm[0] + x, 3), round(self.middle_mm[1] + y, 3)

    def stand(self, well: str) -> WellDish:
        """The well, as a part is put into it."""
        return WellDish(well, self.centre_mm(well), self.dish, self.bath_mm, self.safe_z_mm)


def standing_plate(
    plate: Plate,
    printer: Printer,
    a1_mm: tuple[float, float] | None = None,
    turned_deg: int = 0,
    bath_mm: float | None = None,
) -> StandingPlate:
    """Put a plate on a printer, by default in the middle of its work area.

    Raises
    ------
    RecipeError
        When tips can't be raised above its rims.
    """
    middle = (
        (printer.x_mm.low + printer.x_mm.high) / 2,
        (printer.y_mm.low + printer.y_mm.high) / 2,
    )
    standing = StandingPlate(plate, middle, turned_deg, printer.z_mm.low, bath_mm)
    if a1_mm is not None:
        x, y = standing.turned(*plate.offset_mm("A1"))
        standing = StandingPlate(
            plate, (a1_mm[0] - x, a1_mm[1] - y), turned_deg, printer.z_mm.low, bath_mm
        )
    if standing.safe_z_mm > printer.z_mm.high:
        raise RecipeError(
            f"plate.profile: {plate.name} is {plate.height_mm:g} mm high, and a tip that clears it "
            f"by {RIM_CLEARANCE_MM:g} mm would be at z {standing.safe_z_mm:g} mm, above the "
            f"{printer.z_mm.high:g} mm of {printer.name} (z_mm); take a lower plate"
        )
    return standing


Plan = tuple[float, list[str]]


def route(wells: Sequence[str], standing: StandingPlate) -> list[str]:
    """The shortest way row by row, or column by column if that is shorter.

    Each lane is gone through in the direction that makes the whole way shortest: over a whole
    block a serpentine.

    Parameters
    ----------
    wells : sequence of str
    standing : StandingPlate
    """
    plans = [_by_lanes(wells, standing, _row, _column), _by_lanes(wells, standing, _column, _row)]
    return min(plans, key=_rank)[1]


def _rank(plan: Plan) -> tuple[float, list[str]]:
    """Shorter ones first; of equals always the same."""
    return round(plan[0], 6), plan[1]


def _row(well: str) -> int:
    return ord(well[0])


def _column(well: str) -> int:
    return int(well[1:])


def _by_lanes(
    wells: Sequence[str],
    standing: StandingPlate,
    lane_of: Callable[[str], int],
    along: Callable[[str], int],
) -> Plan:
    """The shortest way lane by lane, (length in mm, wells).

    Of all ways through the lanes so far only two matter to the next one: the shortest that ends at
    either end of the last lane.
    """
    ways: list[Plan] = [(0.0, [])]
    for lane in sorted({lane_of(well) for well in wells}):
        inside = sorted((well for well in wells if lane_of(well) == lane), key=along)
        ways = [
            min((_joined(way, turn, standing) for way in ways), key=_rank)
            for turn in (inside, inside[::-1])
        ]
    return min(ways, key=_rank)


def _joined(way: Plan, lane: list[str], standing: StandingPlate) -> Plan:
    length, before = way
    places = [standing.centre_mm(well) for well in [*before[-1:], *lane]]
    length += sum(dist(a, b) for a, b in pairwise(places))
    return length, [*before, *lane]


DESIGN: Final = ("tissue", "vasculature", "solid", "toolpath")
INK: Final = ("flow_factor", "retract_ul", "plunger_ul_s", "dwell_s")
"""Keys of the ink's profile that a job's lines follow from."""
_ONE_JOB: Final = (
    "toolpath.method",
    "toolpath.needle",
    "toolpath.compensate_lag",
    "toolpath.prime",
)
_OTHERS: Final = (
    "a sweep varies what is printed: tissue.…, vasculature.…, solid.…, toolpath.…, seed, "
    f"print_scale, and of the ink's profile {', '.join(f'ink.{key}' for key in INK)}"
)


@dataclass(frozen=True)
class Point:
    """One variant.

    Attributes
    ----------
    values : mapping of str to value
        Swept key to what it is here; empty without a sweep.
    """

    values: Mapping[str, Any] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """For people, in one line: what each key is about, its value and unit."""
        return ", ".join(_words(key, value) for key, value in self.values.items())

    @property
    def ink(self) -> dict[str, Any]:
        """What it changes of the ink's profile."""
        return {
            key.partition(".")[2]: value
            for key, value in self.values.items()
            if key.startswith("ink.")
        }


def _words(key: str, value: Any) -> str:
    name, unit = label_and_unit(key.rpartition(".")[2])
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{name[:1].lower()}{name[1:]} {text} {unit}".rstrip()


def points(sweep: Mapping[str, Sequence[Any]], combine: str) -> list[Point]:
    """All variants, the last key's values varying fastest; one without a sweep.

    Raises
    ------
    RecipeError
        For a key that no sweep can vary.
    """
    for key in sweep:
        _check_key(key)
    rows = product(*sweep.values()) if combine == "grid" else zip(*sweep.values(), strict=True)
    if not sweep:
        return [Point()]
    variants = [Point(dict(zip(sweep, row, strict=True))) for row in rows]
    twice = next((point for point in variants if variants.count(point) > 1), None)
    if twice:
        raise RecipeError(
            f"plate.sweep holds {twice.label} more than once; say it once, and copies for more"
        )
    return variants


def _check_key(key: str) -> None:
    section, _, inside = key.partition(".")
    if any(f"{key}.".startswith(f"{one}.") for one in _ONE_JOB):
        raise RecipeError(f"plate.sweep: {key} can't differ from well to well within one job")
    if section == "ink" and inside not in INK:
        raise RecipeError(f"plate.sweep: {key} isn't among what can be varied; {_OTHERS}")
    if key in ("seed", "print_scale") or section == "ink" or (section in DESIGN and inside):
        return
    raise RecipeError(f"plate.sweep: {key} isn't among what can be varied; {_OTHERS}")


def varied_recipe(recipe: Recipe, point: Point, well: str) -> Recipe:
    """The recipe of one well alone, without its plate, held against the recipe's own schema.

    Raises
    ------
    RecipeError
        For a key that the recipe hasn't, or a value that it refuses.
    """
    design = {key: value for key, value in point.values.items() if not key.startswith("ink.")}
    origin = f"plate.sweep ({point.label})" if point.values else "plate"
    return overridden(recipe, design, f"{recipe.name[:56]}_{well}", origin)


def varied_ink(ink: Ink, changes: Mapping[str, Any]) -> Ink:
    """The ink's profile with a variant's values.

    Raises
    ------
    RecipeError
        For a value out of its bounds.
    """
    if not changes:
        return ink
    try:
        return Ink.model_validate(ink.model_dump(exclude_unset=True) | dict(changes))
    except ValidationError as exc:
        wrong = exc.errors()[0]
        key = ".".join(str(part) for part in wrong["loc"])
        raise RecipeError(
            f"plate.sweep: ink.{key}: {wording(wrong)} (is {wrong['input']!r})"
        ) from exc


@dataclass(frozen=True)
class Well:
    """A well and what is printed in it.

    Attributes
    ----------
    name : str
    variant : int
        Number of its point of the sweep, from 0.
    point : Point
    copy : int
        Which of the variant's wells it is, from 1.
    """

    name: str
    variant: int
    point: Point
    copy: int

    @property
    def label(self) -> str:
        """For people: what is varied, or which copy."""
        return self.point.label or f"copy {self.copy}"


def assigned(part: PlatePart, plate: Plate) -> list[Well]:
    """Every well that is printed in, in the order in which the recipe names them.

    Neighbouring wells hold different variants: after one of each comes the next copy of each, so
    that what drifts while a plate is printed doesn't fall on one variant alone.

    Raises
    ------
    RecipeError
        For wells that aren't there, or that don't come out even.
    """
    variants = points(part.sweep, part.combine)
    names = _names(part, plate, len(variants))
    return [
        Well(name, k % len(variants), variants[k % len(variants)], k // len(variants) + 1)
        for k, name in enumerate(names)
    ]


def _names(part: PlatePart, plate: Plate, variants: int) -> Sequence[str]:
    if part.wells is None:
        wanted = variants * (part.copies or 1)
        if wanted > len(plate.wells):
            raise RecipeError(
                f"plate: {variants} variants and {part.copies or 1} copies of each make {wanted} "
                f"parts, and {plate.name} has {len(plate.wells)} wells; vary less, or take a "
                "plate with more"
            )
        return plate.wells[:wanted]
    names = list(plate.wells) if part.wells == "all" else expand(part.wells, plate, "plate.wells")
    copies, left = divmod(len(names), variants)
    if left or (part.copies is not None and part.copies != copies):
        wanted = part.copies or max(1, copies)
        raise RecipeError(
            f"plate.wells names {len(names)} wells, and {variants} variants with {wanted} "
            f"{'copies' if wanted > 1 else 'copy'} of each take {wanted * variants}; name so many, "
            "or leave wells out"
        )
    return names


def scanned_wells(part: PlatePart, plate: Plate, wells: Sequence[Well]) -> list[str]:
    """Wells whose scan is held against the design, in the order of ``wells``.

    Raises
    ------
    RecipeError
        For a well in which nothing is printed.
    """
    if part.scanned is None:
        return [wells[0].name]
    printed = [well.name for well in wells]
    if part.scanned == "all":
        return printed
    named = expand(part.scanned, plate, "plate.scanned")
    empty = [name for name in named if name not in printed]
    if empty:
        raise RecipeError(
            f"plate.scanned names {empty[0]}, in which nothing is printed; name some of "
            f"{', '.join(printed[:12])}{' …' if len(printed) > 12 else ''}"
        )
    return [name for name in printed if name in named]
