"""Data classes of a decision, and of the tolerances that it hangs on."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal

from printctl.observe.deciding.flow_control import FlowLimits
from printctl.observe.deciding.gap_test import GapTest
from printctl.observe.deciding.thin import Thin
from registration.inspection.values import Gap

Mode = Literal["tell", "ask", "mend"]


class DecisionKind(StrEnum):
    """What is done after a look."""

    GO_ON = "go_on"
    FLOW = "flow"
    MEND = "mend"
    PAUSE = "pause"
    STOP = "stop"


@dataclass(frozen=True)
class Limits:
    """Tolerances, and what may be done unasked.

    Attributes
    ----------
    gap : GapTest
    flow : FlowLimits
    width_percent : float
        Deviation of a line's width that isn't told.
    lumen_percent : float
        By which a lumen may be seen narrower.
    shift_mm : float, mm
        By which a layer may lie beside its place.
    unseen_mm : float, mm
        Stretch of a vessel in a bath that needn't be seen.
    least_seen : float
        Share of the way that must be seen for a look to count.
    unseen_looks : int
        Layers in a row (in a bath looks) that didn't count, after which the print is paused.
    mend : "tell", "ask" or "mend"
    """

    gap: GapTest = field(default_factory=GapTest)
    flow: FlowLimits = field(default_factory=FlowLimits)
    width_percent: float = 15.0
    lumen_percent: float = 10.0
    shift_mm: float = 0.1
    unseen_mm: float = 1.5
    least_seen: float = 0.5
    unseen_looks: int = 3
    mend: Mode = "ask"

    @property
    def least_open(self) -> float:
        """Share of a lumen's width that must be open."""
        return 1.0 - self.lumen_percent / 100.0


@dataclass(frozen=True)
class Decision:
    """Outcome of a look.

    Attributes
    ----------
    kind : DecisionKind
        What is done now.
    why : str
        For operator and journal.
    gaps : tuple of Gap
        To be mended; told alone where the print just goes on.
    thin : tuple of Thin
        To be filled up.
    factor : float or None
        Flow factor from here on.
    ask : DecisionKind or None
        What the operator is asked to approve, while the print waits; None for nothing.
    """

    kind: DecisionKind
    why: str
    gaps: tuple[Gap, ...] = ()
    factor: float | None = None
    ask: DecisionKind | None = None
    thin: tuple[Thin, ...] = ()
