"""Print set-up data: mounted printer, needle, syringe, ink, dish, bath; and check results.

The checks themselves, which look at G-code, are in `printctl.checks.preflight`.

Goes in: names of profiles. Comes out: a `SetUp`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final, Literal

from firmware_profiles import Bath, Dish, Ink, Needle, Printer, Syringe, load
from firmware_profiles.tools import THINNEST_BORE
from printctl.checks.kinds import Kind
from printctl.errors import SafetyError, UsageError
from printctl.settings import opt, settings

Weight = Literal["refuses", "warns"]


@dataclass(frozen=True)
class Check:
    """A question asked of the G-code or the set-up, and its answer.

    Attributes
    ----------
    kind : Kind
        What was looked at, for programs.
    check : str
        The same for people.
    value, limit : float
        What was found and what is allowed, in `unit`.
    unit : str
        Of both.
    passed : bool
        Whether the print may go on.
    place : str
        Line of the G-code or key of the profile; empty when it has none.
    remedy : str
        What to do when it didn't pass.
    weight : "refuses" or "warns"
        Whether a print may go on that didn't pass: ``warns`` where no machine can know, or where
        the number it rests on was never measured.
    """

    kind: Kind
    check: str
    value: float
    limit: float
    unit: str
    passed: bool
    place: str = ""
    remedy: str = ""
    weight: Weight = "refuses"

    @property
    def refuses(self) -> bool:
        """Whether no print may begin."""
        return not self.passed and self.weight == "refuses"

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return asdict(self)

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Check:
        """Read `as_dict`."""
        return Check(**{**data, "kind": Kind(data["kind"])})

    def sentence(self) -> str:
        """For the user, when it didn't pass."""
        where = f" ({self.place})" if self.place else ""
        if self.value == self.limit == 0:  # asked of a person; there is nothing to compare
            return f"{self.check}{where}: {self.remedy}"
        value = f"{self.value:g} {self.unit}".rstrip()
        return f"{self.check}: {value}, limit {self.limit:g}{where}; {self.remedy}"

    def row(self) -> str:
        """One line of a table for people."""
        mark = "ok  " if self.passed else "FAIL" if self.refuses else "WARN"
        return f"{mark} {self.check:<52} {self.value:10.4g} {self.unit:<6} limit {self.limit:g}"


def finding(kind: Kind, check: str, place: str, remedy: str, weight: Weight = "refuses") -> Check:
    """Return a check that didn't pass, and that compares no numbers."""
    return Check(kind, check, 0, 0, "", False, place, remedy, weight)


def none_of(
    kind: Kind, check: str, count: int, place: str, remedy: str, weight: Weight = "refuses"
) -> Check:
    """Return a check that passes where nothing was counted."""
    return Check(kind, check, count, 0, "", not count, place, remedy, weight)


def warnings(checks: Iterable[Check]) -> list[str]:
    """What a person must know before the print begins."""
    return [check.sentence() for check in checks if not check.passed and not check.refuses]


def placed_failures(checks: Iterable[Check]) -> tuple[tuple[int, str], ...]:
    """Line of the G-code (0 for none) and sentence of each check that didn't pass."""
    failed = [check for check in checks if not check.passed]
    lines = [re.search(r"\bline (\d+)", check.place) for check in failed]
    return tuple(
        (int(line[1]) if line else 0, check.sentence())
        for line, check in zip(lines, failed, strict=True)
    )


def refusal_of(checks: Iterable[Check]) -> SafetyError | None:
    """Return the error that names every check that didn't pass; None where all did."""
    failed = [check for check in checks if check.refuses]
    if not failed:
        return None
    sentences = [check.sentence() for check in failed]
    kinds = dict.fromkeys(check.kind for check in failed)
    return SafetyError("\n".join(["refused before the first byte was sent:", *sentences]), kinds)


def refuse_failed(checks: Iterable[Check]) -> None:
    """Raise `SafetyError` naming every check that didn't pass."""
    if (refusal := refusal_of(checks)) is not None:
        raise refusal


@dataclass(frozen=True)
class Budget:
    """Time limit of the cells.

    Attributes
    ----------
    minutes : float, min
    source : str
        Where the number comes from.
    key : str
        Where it was said.
    refuses : bool
        Whether a longer print is refused: where the user said it for this print, or the ink was
        measured.
    """

    minutes: float
    source: str
    key: str
    refuses: bool


def budget_of(ink: Ink, minutes: float | None = None, source: str | None = None) -> Budget | None:
    """The recipe's budget where it says one, else the ink's; None where nobody knows."""
    if minutes is not None and source is not None:
        return Budget(minutes, source, "printer.care.viability_min", True)
    if ink.viability_min is None or ink.viability_source is None:
        return None
    key = f"{ink.name}: viability_min"
    return Budget(ink.viability_min, ink.viability_source, key, ink.calibrated)


def shortest_budget(
    inks: Iterable[Ink], minutes: float | None = None, source: str | None = None
) -> Budget | None:
    """Return the least time of several inks' cells, as `budget_of`; None where nobody knows."""
    budgets = [budget_of(ink, minutes, source) for ink in {one.name: one for one in inks}.values()]
    return min((one for one in budgets if one), key=lambda one: one.minutes, default=None)


Point = tuple[float, float, float]
WALL_CLEARANCE_MM: Final = 1.0
"""Kept between needle and wall: a touch-off by eye is no better."""
ABOVE_WALL_MM: Final = 2.0
"""Between the dish's wall and the tips that cross it."""
HUB_MM: Final = 12.0
"""Taken for a hub that nobody measured: a Luer lock's outside, and some."""


@dataclass(frozen=True)
class PlacedDish:
    """Dish at its position on the printer.

    Attributes
    ----------
    dish : Dish
    centre_mm : (x, y), mm
        Printer's frame.
    floor_mm : float, mm
        Height of its floor, printer's frame.
    bath_mm : float or None, mm
        Depth of the bath; None where nobody said it.
    bath_key, centre_key : str
        Where depth and centre are said, for messages.
    """

    dish: Dish
    centre_mm: tuple[float, float]
    floor_mm: float
    bath_mm: float | None = None
    bath_key: str = "printer.bath_depth_mm"
    centre_key: str = "printer.dish_centre_mm"

    @property
    def area_mm2(self) -> float:
        """Of the bath's surface, mm²."""
        box = self.dish.inner_x_mm * self.dish.inner_y_mm
        return math.pi / 4 * box if self.dish.shape == "round" else box

    def risen_mm(self, needle: Needle, deepest_mm: float, ink_ul: float) -> float:
        """Depth of the bath when ink and needle are in it, mm; of one that nobody said, 0.

        Parameters
        ----------
        needle : Needle
        deepest_mm : float, mm
            How far it dips in.
        ink_ul : float, µL
        """
        if self.bath_mm is None:
            return 0.0
        dipped_ul = math.pi / 4 * needle.outer_mm**2 * max(deepest_mm, 0.0)
        return self.bath_mm + (max(ink_ul, 0.0) + dipped_ul) / self.area_mm2


def wall_gap_of(ends: Sequence[Point], standing: PlacedDish, outer_mm: float) -> float:
    """Return the distance of a needle to the wall in one straight move, mm; above it infinite.

    As `printctl.checks.preflight.dish.wall_gap` of many moves, without NumPy, which a
    station's and a link's process don't load.

    Parameters
    ----------
    ends : two (x, y, z), mm
        Before and after, printer's frame.
    standing : PlacedDish
    outer_mm : float, mm
        The needle's.
    """
    dish = standing.dish
    if min(z for _, _, z in ends) >= standing.floor_mm + dish.wall_mm:
        return math.inf
    aside = [(abs(x - standing.centre_mm[0]), abs(y - standing.centre_mm[1])) for x, y, _ in ends]
    if dish.shape == "round":
        gap = min(dish.inner_x_mm / 2 - math.hypot(x, y) for x, y in aside)
    else:
        gap = min(min(dish.inner_x_mm / 2 - x, dish.inner_y_mm / 2 - y) for x, y in aside)
    return gap - outer_mm / 2


def hub_gap_of(ends: Sequence[Point], standing: PlacedDish, needle: Needle) -> float:
    """Return the distance of the needle's hub to the wall in one move, as `wall_gap_of`."""
    hubs = [(x, y, z + needle.length_mm) for x, y, z in ends]
    return wall_gap_of(hubs, standing, needle.hub_outer_mm or HUB_MM)


@dataclass(frozen=True)
class HeadLoading:
    """Syringe, ink and needle of a head; None for an unknown needle."""

    syringe: Syringe
    ink: Ink
    needle: Needle | None


@dataclass(frozen=True)
class Keys:
    """How a user says things, for remedies: where the part stands, a mounted part, reloads."""

    place: str
    part: str
    reload: str


OPTION_KEYS: Final = Keys(
    "`printctl slice --place`; of a recipe printer.place_mm", "--{}", "specify --reload"
)
RECIPE_KEYS: Final = Keys("printer.place_mm", "{} in the recipe", "say printer.care.reload: true")


@dataclass(frozen=True)
class SetUp:
    """Mounted parts and filled syringes of a print.

    Attributes
    ----------
    printer : Printer
    syringe : Syringe
    ink : Ink
    needle, bath : Needle, Bath or None
        None where nobody said it.
    standing : PlacedDish or None
        The dish, where it stands and how high it is filled.
    heads : tuple of HeadLoading
        What each of several heads holds; syringe, ink and needle are then the first one's.
    thinnest_bore : float
        Narrowest line allowed, as a part of the needle's bore.
    absent : tuple of str
        Of needle, bath and dish those that the user says aren't there.
    start_mm : (x, y, z) or None, mm
        Where the tip stands before the first line; None where nobody said it.
    names : mapping of str to str
        Profile of each part as it was named; of several heads one for each, with commas.
    words : tuple of str
        Options of `printctl print` that name all of it.
    keys : Keys
    """

    printer: Printer
    syringe: Syringe
    ink: Ink
    needle: Needle | None = None
    bath: Bath | None = None
    standing: PlacedDish | None = None
    heads: tuple[HeadLoading, ...] = ()
    thinnest_bore: float = THINNEST_BORE
    absent: tuple[str, ...] = ()
    start_mm: Point | None = None
    names: Mapping[str, str] = field(default_factory=dict)
    words: tuple[str, ...] = ()
    keys: Keys = OPTION_KEYS

    @property
    def loads(self) -> list[HeadLoading]:
        """What each head holds."""
        return [self.load_of(number) for number in range(self.printer.head_count)]

    @property
    def inks(self) -> list[Ink]:
        """What each head writes."""
        return [one.ink for one in self.loads]

    def load_of(self, number: int) -> HeadLoading:
        """What a head holds; the same in each where nobody said it of each."""
        if number < len(self.heads):
            return self.heads[number]
        return HeadLoading(self.syringe, self.ink, self.needle)


NONE: Final = "none"
"""In place of a profile: nothing is mounted, as in an air print."""


@settings
class ProfileNames:
    """Names of what is mounted; None for what wasn't given."""

    needle: str | None = opt(
        "Needle profile; plunger force and walls need it. Of several heads: left,right. none: no "
        "needle."
    )
    bath: str | None = opt("Bath profile; gelation and temperatures need it. none: no bath.")
    dish: str | None = opt("Dish profile; walls need it. none: no dish.")
    dish_centre: str | None = opt("Printer's frame; below --start if not.", metavar="X,Y")
    bath_depth: float | None = opt("How high the dish is filled, mm.", min=0.1)
    thinnest_bore: float = opt(
        "Narrowest line, over the needle's bore (0.8 of 0.2 mm are 0.16 mm); try it on the ink "
        "first.",
        THINNEST_BORE,
        min=0.05,
        max=2.0,
    )

    def words(self) -> tuple[str, ...]:
        """Return the options that name them again."""
        given = vars(self) | {
            "thinnest_bore": None if self.thinnest_bore == THINNEST_BORE else self.thinnest_bore
        }
        return options_of(given)


def options_of(values: Mapping[str, object]) -> tuple[str, ...]:
    """Return command-line options that give these values by name; none for None."""
    return tuple(
        word
        for name, value in values.items()
        if value is not None
        for word in (f"--{name.replace('_', '-')}", str(value))
    )


def set_up(
    printer: Printer,
    syringe: str,
    ink: str,
    tip: Point | None,
    mounted: ProfileNames,
    keys: Keys = OPTION_KEYS,
) -> SetUp:
    """Set-up of named profiles; of several heads syringe, ink and needle may be one for each.

    Raises
    ------
    UsageError, ProfileError
        For a centre that isn't two numbers; for a profile that there isn't.
    """
    absent = tuple(one for one in ("needle", "bath", "dish") if vars(mounted)[one] == NONE)
    bath, dish = (None if name == NONE else name for name in (mounted.bath, mounted.dish))
    standing = None
    if dish is not None:
        centre = (
            read_dish_centre(mounted.dish_centre) if mounted.dish_centre else (tip or (0, 0))[:2]
        )
        where = ("--bath-depth", "--dish-centre")
        standing = PlacedDish(
            load(Dish, dish), centre, printer.z_mm.low, mounted.bath_depth, *where
        )
    elif mounted.dish_centre is not None or mounted.bath_depth is not None:
        raise UsageError("--dish-centre and --bath-depth belong to a dish; give --dish")
    loads = loads_of(printer, syringe, ink, mounted.needle)
    return SetUp(
        printer,
        loads[0].syringe,
        loads[0].ink,
        loads[0].needle,
        None if bath is None else load(Bath, bath),
        standing,
        loads if printer.heads else (),
        mounted.thinnest_bore,
        absent,
        tip,
        {
            **{"syringe": syringe, "ink": ink},
            **{part: vars(mounted)[part] or "" for part in ("needle", "bath", "dish")},
        },
        ("--syringe", syringe, "--ink", ink, *mounted.words()),
        keys,
    )


def of_each(printer: Printer, text: str, option: str) -> list[str]:
    """Names of one thing in each head: ``left,right``, or one for all.

    Raises
    ------
    UsageError
        For another number of names than there are heads.
    """
    names = text.split(",")
    if len(names) not in (1, printer.head_count):
        raise UsageError(
            f"{option} {text!r} names {len(names)}, and {printer.name} has {printer.head_count} "
            "heads; name one of each, with a comma between, or one for all"
        )
    return names * (printer.head_count // len(names))


def syringes_of(printer: Printer, syringe: str) -> list[Syringe]:
    """The syringe in each head."""
    return [load(Syringe, name) for name in of_each(printer, syringe, "--syringe")]


def loads_of(
    printer: Printer, syringe: str, ink: str, needle: str | None
) -> tuple[HeadLoading, ...]:
    """What each head holds."""
    inks = [load(Ink, name) for name in of_each(printer, ink, "--ink")]
    needles: list[Needle | None] = [None] * printer.head_count
    if needle is not None and needle != NONE:
        needles = [load(Needle, name) for name in of_each(printer, needle, "--needle")]
    parts = zip(syringes_of(printer, syringe), inks, needles, strict=True)
    return tuple(HeadLoading(*part) for part in parts)


def read_dish_centre(text: str) -> tuple[float, float]:
    """Read the option --dish-centre, X,Y in mm."""
    try:
        x, y = (float(word) for word in text.split(","))
    except ValueError as exc:
        raise UsageError(f"--dish-centre {text!r} isn't X,Y in mm; write it like 100,100") from exc
    if not (math.isfinite(x) and math.isfinite(y)):
        raise UsageError(f"--dish-centre {text!r} has a number that isn't finite")
    return x, y


ASSUMED: Final = {"syringe": "hamilton_1ml", "ink": "collagen_fresh"}
"""Parts of a dry run, a simulated print or a sliced file that names none."""


def or_assumed(
    parts: Mapping[str, str | None], usual: Mapping[str, str] = ASSUMED
) -> tuple[dict[str, str], list[str]]:
    """Fill in the usual parts where none is known; return a note that says which, or none."""
    taken = {part: name for part, name in usual.items() if not parts[part]}
    said = ", ".join(f"{part} {name}" for part, name in taken.items())
    notes = [f"assumed {said}, as no other was named"] if taken else []
    return {part: name or "" for part, name in parts.items()} | taken, notes
