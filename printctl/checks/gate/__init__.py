"""G-code safety gate: allow or refuse each line, typed or from a file, before it is sent.

Pure: it opens nothing and sends nothing. `judge` answers allowed, with the text that is sent, or
refused, with the reason.

Goes in: a line, its origin, the printer's state. Comes out: a verdict. Begin with `judge.py`.
"""

from printctl.checks.gate.heat import check_heat
from printctl.checks.gate.inputs import (
    RIM_MARGIN_MM,
    STEP_DOWN_MM,
    UNNAMED_C,
    AllowedLine,
    Bounds,
    Limit,
    LineAction,
    LineOrigin,
    NotAllowed,
    Phase,
    PrinterSituation,
    Refusal,
    Verdict,
    reach,
    speed_limit,
)
from printctl.checks.gate.judge import (
    changed_settings,
    judge,
    judge_stored_line,
    refused_lines,
)
from printctl.checks.gate.motion import DEFAULT_MM_S, check_homing, check_step

__all__ = [
    "DEFAULT_MM_S",
    "RIM_MARGIN_MM",
    "STEP_DOWN_MM",
    "UNNAMED_C",
    "AllowedLine",
    "Bounds",
    "Limit",
    "LineAction",
    "LineOrigin",
    "NotAllowed",
    "Phase",
    "PrinterSituation",
    "Refusal",
    "Verdict",
    "changed_settings",
    "check_heat",
    "check_homing",
    "check_step",
    "judge",
    "judge_stored_line",
    "reach",
    "refused_lines",
    "speed_limit",
]
