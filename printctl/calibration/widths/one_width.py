"""Derive flow factor, filament swelling or line bead model from a measured cross-section."""

from __future__ import annotations

import math
from dataclasses import dataclass

from printctl.calibration.estimate import Estimate
from printctl.calibration.patterns import WrittenPattern
from printctl.calibration.writing import MeasuredValue
from printctl.errors import UsageError

_FLOW = (0.2, 5.0)
_SWELL = (0.3, 3.0)
_MOST_EXCESS_UM = 500.0


@dataclass(frozen=True)
class GivenValues:
    """Values that the user supplies to the fit.

    Attributes
    ----------
    flow_factor : float or None
        Weighed: what comes out over what is pushed.
    """

    flow_factor: float | None = None


def factors(
    share: Estimate, written: WrittenPattern, known: GivenValues
) -> tuple[dict[str, Estimate], dict[str, MeasuredValue], list[str]]:
    """Flow factor; where that is known, a filament's swelling or a line's bead.

    Raises
    ------
    UsageError
        For a factor or a bead that no ink has.
    """
    mounted, bead = written.mounted, written.pattern.bead
    total = share.times(mounted.flow_factor, "")
    if known.flow_factor is None:
        swell = mounted.swell_factor or 1.0
        flow = total.times(1 / swell**2 if bead.round_bead else 1 / swell, "")
        _within(flow.value, _FLOW, "flow factor")
        taken = "isn't in the profile and is taken as 1"
        if mounted.swell_factor is not None:
            taken = f"is taken as the profile's {swell:g}"
        notes = [
            f"widths can't tell the flow factor from swelling: the swelling {taken}. Weigh what "
            "comes out (printctl calibrate weigh), give --flow-factor, and the swelling (of lines "
            "on a plate their bead) is told instead"
        ]
        change = {"flow_factor": MeasuredValue(flow.value, f"{flow.text()}, 95 %")}
        return {"flow factor": flow}, change, notes
    if not bead.round_bead:
        return _bead(share, written, known.flow_factor)
    ratio = total.times(1 / known.flow_factor, "")
    value, low, high = (math.sqrt(x) for x in (ratio.value, ratio.low, ratio.high))
    swelling = Estimate(value, low, high)
    _within(value, _SWELL, "swelling")
    note = (
        f"the flow factor {known.flow_factor:g} is taken as exact: its error isn't in the swelling"
    )
    change = {
        "swell_factor": MeasuredValue(value, f"{swelling.text()}, 95 %"),
        "flow_factor": MeasuredValue(known.flow_factor, f"{known.flow_factor:g}, as given"),
    }
    return {"swelling (diameter over that written)": swelling}, change, [note]


def _bead(
    share: Estimate, written: WrittenPattern, flow_factor: float
) -> tuple[dict[str, Estimate], dict[str, MeasuredValue], list[str]]:
    """How much wider lines on a plate are than their area over their height, µm."""
    line = written.pattern.bead
    mean = line.area_mm2 / line.layer_mm * flow_factor / written.mounted.flow_factor
    value, low, high = (
        1e3 * (line.width_at(x) - mean) for x in (share.value, share.low, share.high)
    )
    excess = Estimate(value, low, high, "µm")
    if not 0 <= value <= _MOST_EXCESS_UM:
        raise UsageError(
            f"lines are {value:.3g} µm wider than their area over their height, beyond 0 to "
            f"{_MOST_EXCESS_UM:g}: are the widths in mm, is --flow-factor weighed, and are lines "
            f"{line.layer_mm:g} mm high?"
        )
    note = (
        f"the flow factor {flow_factor:g} and the height {line.layer_mm:g} mm are taken as exact: "
        "their error isn't in the bead"
    )
    change = {
        "bead": MeasuredValue(round(value, 2), f"{excess.text()}, 95 %"),
        "flow_factor": MeasuredValue(flow_factor, f"{flow_factor:g}, as given"),
    }
    return {"width over area / height (bead)": excess}, change, [note]


def _within(value: float, span: tuple[float, float], name: str) -> None:
    if not span[0] < value < span[1]:
        raise UsageError(
            f"the widths give a {name} of {value:.3g}, beyond {span[0]:g} to {span[1]:g}: are they "
            "in mm, and of this pattern (--pattern)? Was the pattern written with this needle?"
        )
