"""Decision about the flow, and what is said of it."""

from __future__ import annotations

import math

from printctl.observe.deciding.decision import Decision, DecisionKind
from printctl.observe.deciding.flow_control import FlowControl
from printctl.observe.deciding.thin import Thin


def flow_decision(
    control: FlowControl,
    tolerance: float,
    seem_thin: tuple[Thin, ...] = (),
    told: bool = True,
) -> Decision | None:
    """Return what a flow calls for; None where it is as it should be.

    Parameters
    ----------
    control : FlowControl
    tolerance : float
        Share by which it may be off.
    seem_thin : tuple of Thin
        Lines that seem to have too little ink.
    told : bool
        Whether the look has told any width: without, a flow beyond all bounds is told once more.
    """
    if control.answers.failed:
        return _unanswered(control)
    flows = f"the ink flows at {control.flow:.0%} ± {2 * control.u_flow:.0%} of what is asked for"
    if control.out_of_bounds:
        low, high = control.limits.low, control.limits.high
        why = f"{flows}: beyond a correction by {low:g} to {high:g}"
        said, control.beyond_said = control.beyond_said, not told
        if told or not said:
            why += "; this look tells no width, so whether it still is isn't known" * (not told)
            return Decision(DecisionKind.PAUSE, why)
        return None
    factor = control.proposal()
    if factor is None:
        return _likely_off(control, tolerance, seem_thin)
    return Decision(DecisionKind.FLOW, f"{flows}: factor {factor:.2f}", factor=factor)


def _likely_off(
    control: FlowControl, tolerance: float, seem_thin: tuple[Thin, ...]
) -> Decision | None:
    """Ask about a flow that is likely off, though not surely."""
    seen, factor = control.seen, control.by_last_picture()
    if seen.last is None or factor is None or factor == control.factor:
        return None
    if not seen.likely_off(control.factor, tolerance):
        return None
    seen.asked = seen.last
    share = control.factor * math.exp(seen.last.level)
    thin = seem_thin if factor > control.factor else ()
    way_mm = math.fsum(one.length_mm for one in thin)
    then = f"corrects the flow to {factor:.2f}" + f" and fills {way_mm:.1f} mm up" * bool(thin)
    return Decision(
        DecisionKind.PAUSE,
        f"lines seem to have {share:.0%} ± {2 * share * seen.last.u:.0%} of the ink asked for: "
        "the flow is off, or light makes their edges look so; look at a line or weigh the ink; "
        f"approve {then}, go on leaves it",
        factor=factor, ask=DecisionKind.FLOW, thin=thin,
    )  # fmt: skip


def _unanswered(control: FlowControl) -> Decision | None:
    """Take corrections back that weren't answered, and say so, once."""
    if control.answers.told:
        return None
    control.answers.told = True
    factor = control.proposal()
    back = "" if factor is None else f"; the factor is {factor:.2f} again"
    return Decision(
        DecisionKind.PAUSE,
        f"the flow was corrected to {control.factor:.2f}, and the width of lines hardly changed: "
        "widths are misread (a halo, blur, light or rims beside the lines), or the flow changed "
        f"again meanwhile{back}, and is corrected no more in this print: look at the lines, then "
        "resume or stop",
        factor=factor,
    )


def corrected_words(control: FlowControl, factor: float | None) -> str:
    """Which correction goes with a mend, in words; empty for none."""
    if factor is None:
        return ""
    if control.answers.failed:
        return f"; widths didn't answer corrections of the flow: factor {factor:.2f} again"
    return f"; flow {control.flow:.0%}: factor {factor:.2f}"


def uncorrected_words(control: FlowControl) -> str:
    """Say that the flow isn't corrected; empty where it is."""
    return "; the flow isn't corrected: widths didn't answer it" * control.answers.failed
