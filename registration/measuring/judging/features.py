"""Compare quantities and tolerance zones of a vessel or print with their limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.json_ready import Record
from registration.measuring.judging.decisions import COVERAGE, ORDER, Decision, decide, single_width
from registration.measuring.judging.series import Series
from registration.measuring.judging.tolerance import (
    DecisionRule,
    Limit,
    Rule,
    Tolerances,
    VesselLimits,
)

FeatureName = Literal[
    "section", "narrowest", "mean", "change", "oval", "offset", "open", "seen", "gel_like",
    "measured", "unsure", "leak", "rms", "rigid", "size", "zone",
]  # fmt: skip


@dataclass(frozen=True)
class Feature:
    """One quantity held against its limits.

    Attributes
    ----------
    name : str
        ``section``: the worst section's diameter; ``narrowest``, ``mean``: diameters; ``change``:
        of a diameter within a junction; ``oval``: how much longer the longest width is than the
        shortest; ``offset``: of the axis; ``open``, ``seen``,
        ``gel_like``, ``measured``, ``unsure``: without a value; ``leak``: the width of a
        leak or bridge; ``rms``, ``rigid``: of the scaled and the rigid fit; ``size``: along an
        axis; ``zone``: a geometric characteristic.
    decision : str
    vessel : int or None
        None: of the whole print.
    at_mm : float or None, mm
        Place along the vessel, where it has one.
    value_um, u_um, lower_um, upper_um : float or None, µm
        Diameters: deviation from the design, half width of its 95 % interval, allowed deviation.
        Offset, leak, RMS: the value, upper limit alone.
    fail_um : float or None, µm
        Half width with which a fail is proven of one of many sections (`decisions.fail_width`).
    designed_um : float or None, µm
        Of diameters.
    limit : str
        In the user's words, like "±10 %".
    unseen_mm : list of (from, to)
        Of ``seen``, ``gel_like``, ``measured`` and ``unsure``: where it isn't known.
    other : int or None
        Of ``leak``: the vessel that a bridge leads into; None: out of the part.
    doubt : str
        ``shade``: of ``leak``, where gel in a shadow would look alike; undecided. ``faint``: of
        ``leak``, where so much gel is left that it may be a crack; undecided. ``axis``: of
        ``leak``, where the axis may not follow its lumen; undecided. ``pose``: a fail
        if the pose, which is in doubt, is right; undecided. ``symmetry``: not a pass if the part
        lay so that this is ``as_vessel``, where the design is the same; undecided. ``no limit``: of
        ``offset``, far aside where nobody has said what is allowed; undecided. ``index``: of
        ``size``, along the light of an OCT without a depth standard; a pass by its value alone.
    words, of : str
        Of a zone: which characteristic, of which feature. Of ``size``: what narrows its interval,
        of which axis.
    interval_um : (low, high), µm
        Of a zone.
    probability : float or None
        Of ``section``, by the rule conformance: that all sections of the vessel conform.
    """

    name: FeatureName
    decision: Decision
    vessel: int | None = None
    at_mm: float | None = None
    value_um: float | None = None
    u_um: float | None = None
    fail_um: float | None = None
    lower_um: float | None = None
    upper_um: float | None = None
    designed_um: float | None = None
    limit: str = ""
    unseen_mm: Sequence[Sequence[float]] = ()
    other: int | None = None
    doubt: Literal["", "shade", "faint", "axis", "pose", "symmetry", "no limit", "index"] = ""
    words: str = ""
    of: str = ""
    interval_um: Sequence[float] = ()
    probability: float | None = None


@dataclass(frozen=True)
class Band:
    """A vessel's sections with what is allowed there; (n,) each.

    Attributes
    ----------
    series : Series
    below_um, above_um : float64, µm
        Allowed deviation, >= 0.
    u_fail_um : float64, µm
        Half width with which a section may be called a fail.
    code : int64
        Decision of each section, an index into `ORDER`.
    conformance : float
        Probability that all sections conform; NaN where one isn't known.
    decision : str
        On all sections.
    """

    series: Series
    below_um: FloatArray
    above_um: FloatArray
    u_fail_um: FloatArray
    code: NDArray[np.int64]
    conformance: float
    decision: Decision

    @property
    def excess(self) -> FloatArray:
        """How far |error| + U reaches, over the limit on that side; inf where not known."""
        error = self.series.error_um
        room = np.where(error >= 0, self.above_um, self.below_um)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = (np.abs(error) + self.series.u_um) / room
        return np.where(np.isfinite(ratio), ratio, np.inf)


def worst_section(band: Band, chosen: NDArray[np.bool_] | None = None) -> int | None:
    """Index of the worst section: by decision, then by how far it reaches; None without any."""
    there = np.ones(len(band.code), dtype=np.bool_) if chosen is None else chosen
    if not there.any():
        return None
    rank = np.where(there, band.code, -1)
    candidates = np.flatnonzero(rank == rank.max())
    return int(candidates[np.argmax(band.excess[candidates])])


def section_feature(band: Band, limits: VesselLimits) -> list[Feature]:
    """Judge the sections of a vessel by the worst of them."""
    k = worst_section(band)
    if k is None:
        return []
    worst = _diameter("section", band, k, band.decision, limits.section)
    told = limits.rule.name is DecisionRule.CONFORMANCE and math.isfinite(band.conformance)
    return [replace(worst, probability=band.conformance if told else None)]


def narrowest_feature(band: Band, limits: VesselLimits) -> list[Feature]:
    """Judge the narrowest section by a limit of its own."""
    if limits.narrowest is None or not len(band.code):
        return []
    series = band.series
    k = int(np.argmin(series.error_um))
    below, _ = limits.narrowest.around(series.designed_um[k : k + 1])
    one = slice(k, k + 1)
    wide = np.full(1, math.inf)
    measured = series.error_um[one], series.u_um[one], band.u_fail_um[one]
    code = decide(limits.rule, *measured, below, wide)
    return [
        Feature(
            name="narrowest",
            decision=ORDER[int(code[0])],
            vessel=series.vessel,
            at_mm=float(series.along_mm[k]),
            value_um=float(series.error_um[k]),
            u_um=float(series.u_um[k]),
            fail_um=float(band.u_fail_um[k]),
            lower_um=-float(below[0]),
            designed_um=float(series.designed_um[k]),
            limit=str(limits.narrowest),
        )
    ]


def _diameter(name: FeatureName, band: Band, k: int, decision: Decision, limit: Limit) -> Feature:
    series = band.series
    return Feature(
        name=name,
        decision=decision,
        vessel=series.vessel,
        at_mm=float(series.along_mm[k]),
        value_um=float(series.error_um[k]),
        u_um=float(series.u_um[k]),
        fail_um=float(band.u_fail_um[k]),
        lower_um=-float(band.below_um[k]),
        upper_um=float(band.above_um[k]),
        designed_um=float(series.designed_um[k]),
        limit=str(limit),
    )


def mean_feature(row: Record, band: Band, limits: VesselLimits) -> list[Feature]:
    """Judge the mean diameter over a vessel's open sections.

    A fail allows for what sections of other vessels scatter by, too: the mean of one section
    would otherwise be a fail where the section isn't.
    """
    if row.get("measured_um") is None or not row["measured_um"]:
        return []
    limit = limits.diameter if limits.mean is None else limits.mean
    designed = float(row["designed_um"])
    error = float(row["measured_um"]) - designed
    u = row.get("measured_interval_95_um")
    scattered = _mean_half(band.series)
    half = scattered if u is None else float(u)
    below, above = limit.around(np.array([designed]))
    wide = np.array([single_width(float(np.fmax(half, scattered)))])
    code = decide(limits.rule, np.array([error]), np.array([half]), wide, below, above)
    return [
        Feature(
            name="mean",
            decision=ORDER[int(code[0])],
            vessel=int(row["vessel"]),
            value_um=error,
            u_um=half,
            fail_um=float(wide[0]),
            lower_um=-float(below[0]),
            upper_um=float(above[0]),
            designed_um=designed,
            limit=str(limit),
        )
    ]


def _mean_half(series: Series) -> float:
    """Half width of a mean's 95 % interval: what is shared stays, noise averages out."""
    free = series.measured_um > 0
    if not free.any():
        return math.nan
    random = float(np.sqrt(np.mean(np.nan_to_num(series.random_um[free]) ** 2) / free.sum()))
    return COVERAGE * math.hypot(float(np.sqrt(np.mean(series.common_um[free] ** 2))), random)


def oval_feature(row: Record, limits: VesselLimits) -> list[Feature]:
    """Judge how oval a vessel is: its widths may differ by all of the diameter's tolerance.

    A size's limits hold for each two-point size of a section (ISO 14405-1), not for the circle of
    equal area alone: widths from the lower to the upper limit differ by as much as those do. What
    all walls are off by isn't in that difference. Less is asked for by `cylindricity_um`.
    """
    value, half = row.get("oval_um"), row.get("oval_interval_95_um")
    below, above = limits.section.around(np.array([float(row["designed_um"])]))
    limit = float(below[0] + above[0])
    if value is None or math.isinf(limit):
        return []
    u = math.nan if half is None else float(half)
    return [
        Feature(
            name="oval",
            decision=_upper(limits.rule, float(value), u, limit),
            vessel=int(row["vessel"]),
            at_mm=row.get("oval_at_mm"),
            value_um=float(value),
            u_um=u,
            upper_um=limit,
            limit=f"{_upto(round(limit))} ({limits.section} from width to width)",
        )
    ]


def offset_feature(row: Record, limits: VesselLimits) -> list[Feature]:
    """Judge the lumen's mean distance from the designed axis, where a limit is given.

    Where no place along it is limited, a lumen that anywhere lies farther aside than half its
    radius is undecided: nobody has said that this is allowed, and a mean hides it.
    """
    placed = math.isfinite(min(limits.position_um, limits.profile_um))
    far = [] if placed else _far_aside(row)
    if math.isinf(limits.offset_um):
        return far
    value, half = row.get("offset_um"), row.get("offset_interval_95_um")
    # Without a stated interval nothing is proven of an offset.
    u = math.nan if half is None else float(np.max(half))
    return [
        Feature(
            name="offset",
            decision="undecided"
            if value is None
            else _upper(limits.rule, value, u, limits.offset_um),
            vessel=int(row["vessel"]),
            value_um=value,
            u_um=u,
            upper_um=limits.offset_um,
            limit=_upto(limits.offset_um),
        ),
        *far,
    ]


def _far_aside(row: Record) -> list[Feature]:
    """The section farthest from the designed axis, if beyond half its radius and U."""
    aside = np.array(row.get("offset_along_um") or [], dtype=np.float64)
    if not np.isfinite(aside).any():
        return []
    allowed = np.array(row["designed_along_um"]) / 4
    worst = int(np.nanargmax(aside - allowed))
    u = float(np.max(row.get("offset_interval_95_um") or 0.0))
    if not aside[worst] - u > allowed[worst]:
        return []
    return [
        Feature(
            name="offset",
            decision="undecided",
            vessel=int(row["vessel"]),
            at_mm=float(row["along_mm"][worst]),
            value_um=float(aside[worst]),
            u_um=u,
            limit="no limit given",
            doubt="no limit",
        )
    ]


def _upper(rule: Rule, value: float, u: float, limit: float) -> Decision:
    """Decide on a value with an upper limit alone."""
    code = decide(
        rule, np.array([value]), np.array([u]), np.array([single_width(u)]),
        np.array([math.inf]), np.array([limit]),
    )  # fmt: skip
    return ORDER[int(code[0])]


def _upto(limit: float) -> str:
    return f"at most {limit:g} µm"


def open_features(row: Record, limits: VesselLimits, closed: bool) -> list[Feature]:
    """Judge whether a vessel is open, was seen, and was measured wherever it can be.

    A vessel with a closure in the list of findings is `closed`.
    """
    vessel = int(row["vessel"])
    out = []
    if limits.open:
        states: dict[bool | None, Decision] = {True: "pass", False: "fail", None: "undecided"}
        state = states[False if closed else row["open"]]
        if state != "undecided" or not row.get("unsure_mm"):
            out.append(Feature("open", state, vessel))
    gel_like = row.get("gel_like_mm") or ()
    unseen = [one for one in row.get("unseen_mm") or () if one not in gel_like]
    unknown: dict[FeatureName, Sequence[Sequence[float]]] = {
        "seen": unseen,
        "gel_like": gel_like,
        "measured": row.get("unmeasured_mm") or (),
        "unsure": row.get("unsure_mm") or (),
    }
    out += [Feature(name, "undecided", vessel, unseen_mm=at) for name, at in unknown.items() if at]
    return out


def change_feature(finding: Record) -> Feature:
    """Return the decision on a change that no section shows."""
    size, below_above = float(finding["deviation_um"]), finding["tolerance_um"]
    return Feature(
        name="change",
        decision=finding["decision"],
        vessel=int(finding["vessel"]),
        at_mm=float(finding["at_mm"]),
        value_um=size,
        u_um=finding["u_um"],
        lower_um=float(below_above[0]),
        upper_um=float(below_above[1]),
        designed_um=100 * size / float(finding["deviation_percent"]),
        limit=str(finding["limit"]),
    )


def leak_feature(defect: Record, limits: VesselLimits) -> Feature:
    """Judge a leak's or a bridge's width; any fails unless a width is allowed.

    Of what may be a shadow nothing is proven, not even a pass: it may hide a wider way. Nor is it
    of what is too faint for a way of its width, or of a width whose interval reaches down to none.
    """
    width, half = float(defect["size_um"]), float(defect["error_um"] or 0.0)
    doubt = defect.get("doubt", "")
    decision = _upper(limits.rule, width, half, limits.leak_um)
    if limits.leak_um <= 0:
        decision = "fail" if width > half else "undecided"
    return Feature(
        name="leak",
        decision="undecided" if doubt else decision,
        vessel=int(defect["vessel"]),
        at_mm=float(defect["at_mm"]),
        value_um=width,
        u_um=half,
        upper_um=limits.leak_um,
        limit="none allowed" if limits.leak_um <= 0 else _upto(limits.leak_um),
        other=defect.get("other"),
        doubt=doubt,
    )


def rms_feature(
    rule: Rule,
    rms_um: float | None,
    u_um: float | None,
    limit_um: float,
    name: Literal["rms", "rigid"] = "rms",
) -> Feature:
    """Judge the RMS deviation of a fit; without an interval nothing is proven of it."""
    u = math.nan if u_um is None else u_um
    return Feature(
        name,
        "undecided" if rms_um is None else _upper(rule, rms_um, u, limit_um),
        value_um=rms_um,
        u_um=None if math.isnan(u) else u,
        upper_um=limit_um,
        limit=_upto(limit_um),
    )


FACE_SEEN = 0.95
"""Share of a face that must be seen for a pass."""
_LIMITS = {
    "axis": "position_um",
    "port": "port_position_um",
    "cylindricity": "cylindricity_um",
    "lumen": "profile_um",
}


def judged_zones(
    rows: Sequence[Record], kinds: Mapping[int, str], tolerances: Tolerances
) -> tuple[list[dict[str, object]], list[Feature]]:
    """Return characteristics with limit and decision, and the features of those that have one.

    Parameters
    ----------
    rows : sequence of mappings
        ``characteristics`` of a registration.
    kinds : mapping of int to str
        Of the vessels.
    tolerances : Tolerances
    """
    judged, features = [], []
    for row in rows:
        limit = _limit(row, kinds, tolerances)
        plain: dict[str, object] = {**row, "limit_um": None, "decision": None}
        if math.isfinite(limit) and not str(row.get("note", "")).startswith("not defined"):
            feature = _feature(row, limit, tolerances.limits.rule)
            features.append(feature)
            plain |= {"limit_um": limit, "decision": feature.decision}
        judged.append(plain)
    return judged, features


def _limit(row: Record, kinds: Mapping[int, str], tolerances: Tolerances) -> float:
    if row["name"] == "face":
        return tolerances.face_profile_um
    vessel = int(row["vessel"])
    return float(getattr(tolerances.of(vessel, kinds[vessel]), _LIMITS[row["name"]]))


def _feature(row: Record, limit: float, rule: Rule) -> Feature:
    low, high = row["interval_95_um"]
    known = row["zone_um"] is not None and low is not None and high is not None
    return Feature(
        name="zone",
        decision=_decision(row, float(low), float(high), limit, rule) if known else "undecided",
        vessel=row["vessel"],
        value_um=row["zone_um"],
        upper_um=limit,
        limit=f"at most {limit:g} µm",
        words=str(row["characteristic"]),
        of=str(row["feature"]),
        interval_um=(low, high) if known else (),
    )


def _decision(row: Record, low: float, high: float, limit: float, rule: Rule) -> Decision:
    """Decide by the interval; of a face that wasn't all seen no pass is proven."""
    middle, half = (low + high) / 2, (high - low) / 2
    code = decide(
        rule, np.array([middle]), np.array([half]), np.array([single_width(half)]),
        np.array([math.inf]), np.array([limit]),
    )  # fmt: skip
    decision = ORDER[int(code[0])]
    unseen = row["name"] == "face" and row["seen_fraction"] < FACE_SEEN
    return "undecided" if decision == "pass" and unseen else decision
