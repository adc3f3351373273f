"""Read a scan, register it with the design, judge it: the work behind `printctl register`.

Apart from its options: help needs none of this, and the second process loads what draws meanwhile.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from printctl.cli.options import messages
from printctl.cli.progress_option import Steps
from printctl.cli.register_design import DesignRead
from printctl.pipeline.measurement_record import Corrections
from printctl.pipeline.registering import RegisteredScan
from printctl.recipe.record import RecordPart
from registration import RegistrationOptions, ScanOverrides, register_scan
from registration.corrected import corrected_scan
from registration.measuring.geometry import Datum
from registration.measuring.judging import Tolerances


@dataclass(frozen=True)
class Measuring:
    """How a scan is read and measured.

    Attributes
    ----------
    scan : Path
    said : ScanOverrides
        What its file doesn't say.
    optics, walls : Path or None
        Files of calibrations.
    air_above : bool
    filled : bool
        Lumens are brighter than the gel.
    datums : tuple of Datum
        None for the best fit.
    """

    scan: Path
    said: ScanOverrides
    optics: Path | None
    walls: Path | None
    air_above: bool
    filled: bool
    datums: tuple[Datum, ...]

    @property
    def options(self) -> RegistrationOptions:
        """As the registration takes them."""
        return RegistrationOptions(lumens="bright" if self.filled else "dark", datums=self.datums)


def read_and_register(how: Measuring, design: DesignRead, steps: Steps) -> RegisteredScan:
    """Read the scan and register it."""
    options = how.options
    measured = corrected_scan(how.scan, how.said, how.optics, how.air_above, True, how.walls)
    note(measured.notes)
    steps.begin("registration")
    report = register_scan(measured, design.surface, design.vessels, options)
    return RegisteredScan(how.scan, measured, design.model, design.surface, design.network,
                      design.vessels, report, design.printed,
                      design.lumens)  # fmt: skip


def judge_registration(
    made: RegisteredScan, how: Measuring, limits: Tolerances, stated: RecordPart
) -> dict[str, Any]:
    """Numbers and verdict, with the measurement record."""
    data = made.judged(limits)
    done = Corrections(_text(how.optics), how.air_above)
    made.add_record(data, stated, done, datetime.now(UTC))
    return data


def note(notes: list[str] | tuple[str, ...]) -> None:
    """Print what a user should know, beside the results."""
    for note in notes:
        messages().print(f"note: {note}", markup=False)


def _text(path: Path | None) -> str | None:
    return None if path is None else str(path)
