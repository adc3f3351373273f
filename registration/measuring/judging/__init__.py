"""Judge a registration's sections, vessels and whole print against tolerances.

Names are loaded when first asked for: a recipe needs the tolerances alone.

Goes in: a registration's numbers and tolerances. Comes out: decisions and findings. Begin with
`judge_registration.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from registration.measuring.judging.decisions import Decision, worst_decision
    from registration.measuring.judging.judge_registration import (
        decision_at_sure_pose,
        judge,
        judge_plain,
        list_findings,
        pose_in_doubt,
        withhold_unsure,
    )
    from registration.measuring.judging.tolerance import (
        DecisionRule,
        Limit,
        Override,
        Rule,
        ToleranceError,
        Tolerances,
        VesselLimits,
    )
    from registration.measuring.judging.wording import reason

__all__ = [
    "Decision",
    "DecisionRule",
    "Limit",
    "Override",
    "Rule",
    "ToleranceError",
    "Tolerances",
    "VesselLimits",
    "decision_at_sure_pose",
    "judge",
    "judge_plain",
    "list_findings",
    "pose_in_doubt",
    "reason",
    "withhold_unsure",
    "worst_decision",
]

__getattr__, __dir__ = on_demand(__name__)
