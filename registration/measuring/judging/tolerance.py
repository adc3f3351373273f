"""Tolerances of a print, and the decision rules that they are judged by."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np

from design.network import VesselKind, VesselNetwork
from kernels.arrays import FloatArray
from registration.errors import RegistrationError


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


class ToleranceError(RegistrationError):
    """A tolerance that can't be used; the message says which, its value and the remedy."""


@dataclass(frozen=True)
class Limit:
    """By how much a diameter may be smaller (minus) or larger (plus) than designed, all >= 0.

    Where a percentage and a length are both given the tighter one holds; inf: not limited.

    Attributes
    ----------
    minus_percent, plus_percent : float, %
        Of the designed diameter.
    minus_um, plus_um : float, µm
    """

    minus_percent: float = math.inf
    plus_percent: float = math.inf
    minus_um: float = math.inf
    plus_um: float = math.inf

    def around(self, designed_um: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Allowed deviation below and above designed diameters (n,), µm, both >= 0."""
        below = np.minimum(designed_um * (self.minus_percent / 100), self.minus_um)
        above = np.minimum(designed_um * (self.plus_percent / 100), self.plus_um)
        return below, above

    def __str__(self) -> str:
        parts = [(self.minus_percent, self.plus_percent, "%"), (self.minus_um, self.plus_um, "µm")]
        texts = [_pair(m, p, unit) for m, p, unit in parts if math.isfinite(min(m, p))]
        return " and ".join(texts) or "no limit"


def symmetric(percent: float) -> Limit:
    """Return ± `percent` of the designed diameter."""
    return Limit(minus_percent=percent, plus_percent=percent)


def _pair(minus: float, plus: float, unit: str) -> str:
    if minus == plus:
        return f"±{plus:g} {unit}"
    if math.isinf(plus):
        return f"not below \N{MINUS SIGN}{minus:g} {unit}"
    if math.isinf(minus):
        return f"not above +{plus:g} {unit}"
    return f"+{plus:g}/\N{MINUS SIGN}{minus:g} {unit}"


@dataclass(frozen=True)
class VesselLimits:
    """What a vessel is held against.

    Attributes
    ----------
    diameter : Limit
        Of every section.
    mean : Limit or None
        Of the mean diameter; None: as `diameter`.
    narrowest : Limit or None
        Of the narrowest section, its lower side; with `diameter`, the tighter holds.
    offset_um : float, µm
        Of the lumen's mean distance from the designed axis; inf: not judged.
    leak_um : float, µm
        Widest leak or bridge that is allowed.
    open : bool
        Whether the vessel must be open from end to end.
    position_um, port_position_um, cylindricity_um, profile_um : float, µm
        Widths of zones (ISO 1101): of its axis, of its mouths, of its wall's form, of its wall;
        inf: not judged.
    rule : Rule
        By which all of it is decided.
    """

    diameter: Limit = field(default_factory=lambda: symmetric(10.0))
    mean: Limit | None = None
    narrowest: Limit | None = None
    offset_um: float = math.inf
    leak_um: float = 0.0
    open: bool = True
    position_um: float = math.inf
    port_position_um: float = math.inf
    cylindricity_um: float = math.inf
    profile_um: float = math.inf
    rule: Rule = field(default_factory=Rule)

    @property
    def section(self) -> Limit:
        """What every section is held against: none may be narrower than the narrowest may."""
        return self.diameter if self.narrowest is None else _tighter(self.diameter, self.narrowest)


@dataclass(frozen=True)
class Override:
    """Limits that differ for some vessels.

    Attributes
    ----------
    vessels : frozenset of int
        By number, in the network.
    kinds : frozenset of str
        By kind ("artery", "vein", ...).
    changes : mapping
        Fields of `VesselLimits` to the values that differ.
    """

    vessels: frozenset[int]
    kinds: frozenset[str]
    changes: Mapping[str, Any]

    def holds(self, vessel: int, kind: str) -> bool:
        """Whether it is for this vessel."""
        return vessel in self.vessels or kind in self.kinds


@dataclass(frozen=True)
class Tolerances:
    """What a print is held against.

    Attributes
    ----------
    limits : VesselLimits
        Of every vessel.
    rms_um : float, µm
        Of the RMS deviation of the scaled fit.
    overrides : tuple of Override
        A later one counts where two hold for one vessel.
    face_profile_um : float, µm
        Width of the zone of each outer face; inf: not judged.
    size_percent : float, %
        By which the print may be larger or smaller than designed along each axis; inf: not judged.
        Where this is less than `rms_um`, that is the limit.
    rigid_rms_um : float or None, µm
        Of the RMS deviation of the fit without scales; None: as `rms_um`.
    """

    limits: VesselLimits = field(default_factory=VesselLimits)
    rms_um: float = 100.0
    overrides: tuple[Override, ...] = ()
    face_profile_um: float = math.inf
    size_percent: float = 2.0
    rigid_rms_um: float | None = None

    @property
    def rigid_limit_um(self) -> float:
        """Limit of the RMS deviation of the rigid fit, µm."""
        return self.rms_um if self.rigid_rms_um is None else self.rigid_rms_um

    def of(self, vessel: int, kind: str) -> VesselLimits:
        """Limits of one vessel."""
        limits = self.limits
        for override in self.overrides:
            if override.holds(vessel, kind):
                limits = replace(limits, **override.changes)
        return limits

    def check_network(self, network: VesselNetwork) -> None:
        """Refuse overrides of vessels that `network` doesn't have; raise as `check` does."""
        named = {kind.value: kind.name.lower() for kind in VesselKind}
        self.check({i: named[int(kind)] for i, kind in enumerate(network.kind)})

    def check(self, kinds: Mapping[int, str]) -> None:
        """Refuse overrides of vessels that the network, number to kind, doesn't have.

        Raises
        ------
        ToleranceError
        """
        for override in self.overrides:
            for vessel in sorted(override.vessels - set(kinds)):
                raise ToleranceError(
                    f"tolerances: vessel {vessel} isn't in the network (it has vessels 0 to "
                    f"{max(kinds, default=-1)}); name one of those"
                )
            for kind in sorted(override.kinds - set(kinds.values())):
                raise ToleranceError(
                    f"tolerances: no vessel of the network is of kind {kind!r} (it has "
                    f"{', '.join(sorted(set(kinds.values())))}); name one of those"
                )


def _tighter(limit: Limit, narrowest: Limit) -> Limit:
    return replace(
        limit,
        minus_percent=min(limit.minus_percent, narrowest.minus_percent),
        minus_um=min(limit.minus_um, narrowest.minus_um),
    )
