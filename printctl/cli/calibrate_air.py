"""`printctl calibrate weigh` for a pneumatic head: list timed doses to weigh; fit its flow."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firmware_profiles import Ink, MeasuredFlow, Needle, Pneumatic, Printer, flow_ul_s
from printctl.calibration import FlowWeighing, Readings, fit_flow
from printctl.cli.calibrate_files import write_changed
from printctl.cli.calibrate_options import print_estimates


@dataclass(frozen=True)
class WeighingOptions:
    """What was weighed, out of what."""

    printer: Printer
    head: Pneumatic
    ink: Ink
    needle: Needle


def timed_dose_rows(head: Pneumatic, doses_ul: list[float], flow: float) -> list[list[str]]:
    """Rows of the sheet: seconds from the opening command to the closing one, and a blank."""
    wait_s = np.ceil(head.opening_delay_s * 1e3) / 1e3
    return [[f"{round(dose / flow, 3) + wait_s:.3f}", ""] for dose in doses_ul]


def weigh_flow(
    what: WeighingOptions,
    data: Readings,
    density: tuple[float, float],
    write: Path | None,
    as_json: bool,
) -> None:
    """Fit, tell, and write the flow into a printer's profile if asked."""
    weighing = fit_flow(
        data.numbers["open_s"], data.numbers["mass_mg"], *density, data.last_digit["mass_mg"]
    )
    lines = {f"flow at {what.head.pressure_kpa:g} kPa": weighing.flow_ul_s}
    if weighing.lost_s is not None:
        lines["missing from each opening"] = weighing.lost_s
    print_estimates(lines, _notes(weighing, what), as_json)
    if write is not None:
        measured = MeasuredFlow(
            flow_ul_s=weighing.flow_ul_s.value,
            pressure_kpa=what.head.pressure_kpa,
            ink=what.ink.name,
            needle=what.needle.name,
        )
        dispenser = what.head.model_copy(update={"measured": measured})
        values = dispenser.model_dump(mode="json", exclude_unset=True)
        values["measured"] = measured.model_dump(mode="json")
        write_changed(write, what.printer, "dispenser", values, weighing.flow_ul_s)


def _notes(weighing: FlowWeighing, what: WeighingOptions) -> list[str]:
    foreseen = flow_ul_s(what.ink, what.needle, what.head.pressure_kpa * 1e3) * what.ink.flow_factor
    agrees = weighing.flow_ul_s.holds(foreseen)
    return [
        f"one dose scatters by {weighing.scatter_ul:.3g} µL",
        f"the viscosity of {what.ink.name} foresees {foreseen:.4g} µL/s through "
        f"{what.needle.name}, which {'agrees' if agrees else 'does not agree'}",
        "good for this ink, needle and pressure alone, and for this warmth",
    ]
