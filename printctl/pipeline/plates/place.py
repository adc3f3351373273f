"""Compute the position of a plate on the printer, and of each of its wells."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from firmware_profiles import Dish, Plate, Printer
from printctl.errors import RecipeError

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
