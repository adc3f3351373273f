"""Decision rules by name: how limits count a value's uncertainty (JCGM 106, ISO 14253-1)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class DecisionRule(StrEnum):
    """How a measured value with its uncertainty is held against limits."""

    GUARDED = "guarded"
    CONFORMANCE = "conformance"
    SHARED_RISK = "shared_risk"


@dataclass(frozen=True)
class Rule:
    """A decision rule with its level.

    Attributes
    ----------
    name : DecisionRule
    level : float
        Of ``conformance``: probability from which on a quantity passes; it fails from the same
        probability of the contrary on.
    """

    name: DecisionRule = DecisionRule.GUARDED
    level: float = 0.95

    @property
    def words(self) -> str:
        """Say the rule in a sentence."""
        if self.name is DecisionRule.GUARDED:
            return (
                "ISO 14253-1, guard bands: a pass is proven where value ± U (95 %) lies within the "
                "limits, a fail where it lies beyond them by more than any section of a sound "
                "vessel does in 99 of 100 vessels; else undecided."
            )
        if self.name is DecisionRule.SHARED_RISK:
            return (
                "JCGM 106, shared risk (simple acceptance): a value within its limits passes, one "
                "beyond them fails, whatever its uncertainty."
            )
        return (
            f"JCGM 106, conformance probability: a vessel passes where all of its sections lie "
            f"within the limits with a probability of {100 * self.level:g} % or more, and fails "
            f"where it is {100 * (1 - self.level):g} % or less; else undecided."
        )
