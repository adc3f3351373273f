"""G-code safety gate: allow or refuse each line, typed or from a file, before it is sent.

Pure: it opens nothing and sends nothing. `judge` answers allowed, with the text that is sent, or
refused, with the reason.

Goes in: a line, its origin, the printer's state. Comes out: a verdict. Begin with `judge.py`.
"""

from printctl.checks.gate.heat import check_heat
from printctl.checks.gate.inputs import UNNAMED_C, Limit, LineOrigin, Phase, PrinterSituation
from printctl.checks.gate.job_file import changed_settings, refused_lines
from printctl.checks.gate.judge import judge, judge_line, judge_stored_line
from printctl.checks.gate.limits import RIM_MARGIN_MM, Bounds, reach, speed_limit
from printctl.checks.gate.motion import DEFAULT_MM_S, check_homing, check_step
from printctl.checks.gate.verdict import (
    AllowedLine,
    LineAction,
    NotAllowed,
    Place,
    Refusal,
    Verdict,
)

__all__ = [
    "DEFAULT_MM_S",
    "RIM_MARGIN_MM",
    "UNNAMED_C",
    "AllowedLine",
    "Bounds",
    "Limit",
    "LineAction",
    "LineOrigin",
    "NotAllowed",
    "Phase",
    "Place",
    "PrinterSituation",
    "Refusal",
    "Verdict",
    "changed_settings",
    "check_heat",
    "check_homing",
    "check_step",
    "judge",
    "judge_line",
    "judge_stored_line",
    "reach",
    "refused_lines",
    "speed_limit",
]
