"""Decide after a print's inspection: go on, correct the flow, mend, pause or stop.

Goes in: gaps with p-values, widths in the order of writing. Comes out: the action of least expected
cost, with its reason. Begin with `decide.py`.
"""

from printctl.observe.deciding.decide import Decider
from printctl.observe.deciding.decision import (
    Costs,
    Decision,
    DecisionKind,
    GapTest,
    Limits,
    confirmed_gaps,
)
from printctl.observe.deciding.evidence import (
    Evidence,
    InkSupply,
    SupplyState,
    judge_supply,
)
from printctl.observe.deciding.flow_control import FlowBlocks, FlowControl, FlowLimits

__all__ = [
    "Costs",
    "Decider",
    "Decision",
    "DecisionKind",
    "Evidence",
    "FlowBlocks",
    "FlowControl",
    "FlowLimits",
    "GapTest",
    "InkSupply",
    "Limits",
    "SupplyState",
    "confirmed_gaps",
    "judge_supply",
]
