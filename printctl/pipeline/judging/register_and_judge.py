"""Register a scan to its design and judge it: the service of `printctl register` and of runs."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from design.network import VesselNetwork
from design.solids import Solid
from printctl.pipeline.judging.measurement_record import Corrections, add_record
from printctl.recipe.sections.record import RecordPart
from printctl.run_folder.registration_files import (
    AS_CORDS,
    DEVIATION,
    design_facts,
    scan_facts,
    surface_facts,
    write_deviation,
    write_exports,
)
from registration import RegistrationOptions, RegistrationReport, Scan, register_scan, report_dict
from registration.devices.optics import is_resampled
from registration.measuring.judging import Tolerances, judge, withhold_unsure
from registration.result import SIGN
from report.views import Views, add_scan_places, take_views

if TYPE_CHECKING:
    from design.solids.axes.lumen_axes import FoundLumens


@dataclass(frozen=True, eq=False)
class ScannedDesign:
    """A design that a scan is held against.

    Attributes
    ----------
    surface : Solid
        In mm.
    network : Path
        network.csv, mm.
    vessels : VesselNetwork
    lumens : FoundLumens or None
        Of a network that was found in the model: what is unsure of it.
    cords : bool
        Whether it was written as solid cords.
    """

    surface: Solid
    network: Path
    vessels: VesselNetwork
    _: KW_ONLY
    lumens: FoundLumens | None = None
    cords: bool = False


@dataclass(frozen=True, eq=False)
class JudgedScan:
    """A scan that was registered to its design and judged.

    Attributes
    ----------
    scan : Scan
    design : ScannedDesign
    found : RegistrationReport
    numbers : dict
        As registration.json holds them.
    """

    scan: Scan
    design: ScannedDesign
    found: RegistrationReport
    numbers: dict[str, Any]

    def views(self) -> Views:
        """Take the raw pictures of findings and sections."""
        raw = not is_resampled(self.scan)
        return take_views(self.scan, self.design.surface, self.found, self.numbers, raw)

    def write(self, folder: Path) -> list[str]:
        """Write deviation surface, tables, and files for ParaView and 3D Slicer; return names."""
        write_deviation(folder / DEVIATION, self.found)
        judged = self.found, self.numbers
        return [DEVIATION, *write_exports(folder, self.scan, self.design.vessels, judged)]


def register_and_judge(
    scan: Scan,
    design: ScannedDesign,
    options: RegistrationOptions,
    tolerances: Tolerances,
    record: tuple[RecordPart, Corrections] | None = None,
) -> JudgedScan:
    """Register a scan, judge the numbers, and say of what they are.

    Parameters
    ----------
    scan : Scan
    design : ScannedDesign
    options : RegistrationOptions
        Of a design that was written as cords the lumens count as bright.
    tolerances : Tolerances
    record : RecordPart and Corrections, optional
        What is stated of the measurement, and what was taken out of the scan.

    Raises
    ------
    RegistrationError
        When the scan can't be segmented or doesn't fit the design.
    ToleranceError
        When the tolerances name a vessel or kind that the network doesn't have.
    """
    # A cord is bright, as a lumen is that is filled: both are solid in the scan.
    options = replace(options, lumens="bright") if design.cords else options
    found = register_scan(scan, design.surface, design.vessels, options)
    measured = report_dict(found) | (AS_CORDS if design.cords else {})
    if design.lumens is not None:
        withhold_unsure(measured, design.lumens.stretches)
        measured["unfollowed"] = {
            "share": design.lumens.left,
            "at_mm": design.lumens.left_at.round(3).tolist(),
        }
    numbers = {
        **judge(measured, tolerances),
        "sign_convention": SIGN,
        "measured_by": scan_facts(scan),
        "by_surface": surface_facts(found, design.vessels),
        "design": design_facts(design.network),
    }
    if record is not None:
        add_record(numbers, record[0], scan, record[1], datetime.now(UTC))
    add_scan_places(numbers, scan, found)
    return JudgedScan(scan, design, found, numbers)
