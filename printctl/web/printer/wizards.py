"""Table of calibrations: needs, results, columns of readings, availability on the Printer page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

Sort = Literal["weigh", "backlash", "level", "offset"]


@dataclass(frozen=True)
class Wizard:
    """One calibration.

    Attributes
    ----------
    name : str
        As `printctl calibrate NAME`.
    title, needs, gives : str
    columns : tuple of str
        Of its sheet, the words first; empty for one that is done by the command line alone.
    words : int
        How many of the columns are words.
    printed : bool
        Whether it begins with a test that is printed.
    placed : bool
        Whether a row takes the tip's place.
    writes : tuple of str
        What a measured copy of a profile can be written of.
    """

    name: str
    title: str
    needs: str
    gives: str
    columns: tuple[str, ...] = ()
    words: int = 0
    printed: bool = False
    placed: bool = False
    writes: tuple[Literal["printer", "syringe"], ...] = ()

    @property
    def numbers(self) -> tuple[str, ...]:
        """Columns of numbers."""
        return self.columns[self.words :]


WIZARDS: Final[tuple[Wizard, ...]] = (
    Wizard(
        "weigh",
        "Flow by weight",
        "a balance, covered vials, water or ink of known density, a primed needle above the vial",
        "volume per plunger travel, steps per µL",
        ("travel_mm", "mass_mg"),
        printed=True,
        writes=("printer", "syringe"),
    ),
    Wizard(
        "level",
        "Level of bed and bath",
        "a needle; four or more points, not on one line, on the dry bed and on the bath",
        "slopes, flatness, depth of the bath",
        ("surface", "x_mm", "y_mm", "z_mm"),
        words=1,
        placed=True,
    ),
    Wizard(
        "offset",
        "Offset between two needles",
        "both needles and one mark that each touches at least twice, better five times",
        "offset in x, y and z",
        ("needle", "x_mm", "y_mm", "z_mm"),
        words=1,
        placed=True,
    ),
    Wizard(
        "backlash",
        "Lost motion of an axis",
        "a dial gauge that touches the axis (or the plunger)",
        "lost motion where the axis turns round, its scale",
        ("target_mm", "approach", "measured_mm"),
        printed=True,
    ),
    Wizard("lag", "Pressure lag and flow factor", "a printed line and a microscope", "τ, K"),
    Wizard(
        "pattern",
        "Calibration prints",
        "ink, needle and bath as they will be used",
        "lines, spiral, joints, bridges and a comb of gaps, read by widths",
    ),
    Wizard("widths", "Widths of a calibration print", "a picture or widths", "ink's constants"),
    Wizard("walls", "Offset of scanned walls", "scans of channels of known width", "the offset"),
    Wizard("oct", "Scanner", "scans of a grid and of a step", "the scanner's distortion"),
)
BY_NAME: Final = {wizard.name: wizard for wizard in WIZARDS}
