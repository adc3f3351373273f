"""Combine uncertainty terms into a budget with 95 % interval, after the GUM (JCGM 100:2008)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from scipy.special import stdtrit

LEVEL = 0.95
"""Coverage probability of expanded uncertainties."""


@dataclass(frozen=True)
class Term:
    """One contribution to an uncertainty.

    Attributes
    ----------
    name : str
        What it comes from.
    kind : "A" or "B"
        Evaluated by statistics of this scan, or by other means (GUM 4.2, 4.3).
    standard : float
        Standard uncertainty, in the unit of the quantity, sensitivity included.
    dof : float
        Degrees of freedom of `standard`; inf where it is taken as exact.
    note : str
        What it rests on.
    """

    name: str
    kind: Literal["A", "B"]
    standard: float
    dof: float
    note: str


@dataclass(frozen=True)
class Budget:
    """The terms of one quantity, uncorrelated with each other.

    Attributes
    ----------
    terms : tuple of Term
    """

    terms: tuple[Term, ...]

    @property
    def standard(self) -> float:
        """Combined standard uncertainty (GUM 5.1.2)."""
        return math.hypot(*(term.standard for term in self.terms))

    @property
    def dof(self) -> float:
        """Effective degrees of freedom by Welch and Satterthwaite (GUM G.4.1)."""
        spread = sum(t.standard**4 / t.dof for t in self.terms if t.standard > 0)
        return self.standard**4 / spread if spread > 0 else math.inf

    @property
    def expanded(self) -> float:
        """Half width of the 95 % interval; NaN where a term isn't known."""
        return coverage_factor(self.dof) * self.standard

    def share(self, term: Term) -> float:
        """Share of the combined variance that a term makes."""
        return term.standard**2 / self.standard**2 if self.standard > 0 else 0.0


def coverage_factor(dof: float) -> float:
    """Student's t for 95 % both ways; NaN for NaN."""
    return float(stdtrit(max(dof, 1.0), (1 + LEVEL) / 2))


def rectangular(half_width: float) -> float:
    """Standard uncertainty of what lies anywhere within ± `half_width` (GUM 4.3.7)."""
    return half_width / math.sqrt(3)


def at_either_end(half_width: float) -> float:
    """Standard deviation where a quantity is at either end of ± `half_width` more than between.

    The arc sine distribution (GUM Supplement 1, 6.4.6).
    """
    return half_width / math.sqrt(2)
