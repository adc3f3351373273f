"""Judge a registration: decide on each section, vessel and quantity; list the findings.

One source for all that is shown: plot, tables, files, verdict and page read what `judge` writes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, fields
from typing import Any, Final

import numpy as np

from registration.json_ready import Record, json_ready
from registration.measuring.judging.decisions import (
    ORDER,
    RISK,
    Decision,
    codes,
    conformance,
    decide,
    fail_width,
    worst_decision,
)
from registration.measuring.judging.features import (
    Band,
    Feature,
    change_feature,
    judged_zones,
    leak_feature,
    mean_feature,
    narrowest_feature,
    offset_feature,
    open_features,
    oval_feature,
    rms_feature,
    section_feature,
)
from registration.measuring.judging.runs import BARE, apart_from_sections, findings
from registration.measuring.judging.series import Series, series_of
from registration.measuring.judging.size import size_features
from registration.measuring.judging.symmetry import held_in_all, is_close, renamed, same_poses
from registration.measuring.judging.tolerance import (
    DecisionRule,
    Limit,
    Rule,
    Tolerances,
    VesselLimits,
)

POSE_RULE: Final = "The pose is ambiguous, so what would fail is undecided."
_FAIL_FROM_POSE: Final = {"decision": "undecided", "doubt": "pose"}


def pose_in_doubt(ambiguity: Record) -> bool:
    """Return whether the part may lie so that other places are compared.

    A symmetry of the part changes none of them, but the names of vessels (`same_poses`).

    Parameters
    ----------
    ambiguity : mapping
        Of a registration: ``flag``; ``doubts`` and ``rivals`` with ``lead`` and ``same``, where
        they are known.
    """
    close = [one for one in ambiguity.get("rivals", ()) if is_close(one)]
    symmetric = [one for one in close if one["same"]]
    if not symmetric or len(symmetric) < len(close):
        return bool(ambiguity.get("flag"))
    # Each of these is a doubt; what is left is of the scan.
    return len(ambiguity.get("doubts", ())) > len(symmetric)


def fails_withdrawn(judged: Record) -> dict[str, object]:
    """Return judged numbers in which each fail is undecided; passes stay.

    Features so changed have the ``doubt`` ``pose``.
    """
    judging = judged["judging"]
    return {
        **judged,
        "vessels": [_row(row) for row in judged["vessels"]],
        **{
            key: [{**one, "decision": _withdrawn(one["decision"])} for one in judged[key]]
            for key in ("characteristics", "findings", "defects")
        },
        "judging": {
            **judging,
            "rule": f"{judging['rule']} {POSE_RULE}",
            "decision": "undecided",
            "features": [
                {**one, **(_FAIL_FROM_POSE if one["decision"] == "fail" else {})}
                for one in judging["features"]
            ],
        },
    }


def decision_at_sure_pose(feature: Record) -> Record:
    """Return a feature with the decision that it has if the pose is right."""
    return {**feature, "decision": "fail"} if feature.get("doubt") == "pose" else feature


def _row(row: Record) -> dict[str, object]:
    return {
        **row,
        "decision": _withdrawn(row["decision"]),
        "decision_along": [_withdrawn(one) for one in row["decision_along"]],
    }


def _withdrawn(decision: Any) -> Any:
    return "undecided" if decision == "fail" else decision


_WAYS = ("leak", "bridge")
_ALONG = (
    "along_mm", "diameter_um", "area_mm2", "ovality_along", "offset_along_um", "noise_um",
    "shift_along_um", "designed_along_um", "place_mm", "interval_95_um",
)  # fmt: skip
"""Of a vessel's row, one for each section."""


def judge(numbers: Record, tolerances: Tolerances) -> dict[str, object]:
    """Return a registration's numbers with every decision.

    Parameters
    ----------
    numbers : mapping
        Of `registration.report_dict`, or of a registration.json, judged before or not.
    tolerances : Tolerances

    Returns
    -------
    dict
        As given; ``findings``: defects with ``decision``, and all runs of sections that aren't a
        pass (what tells of one place is one, with the ``changes`` within it); ``defects``: those
        of them that stand out or are measured beyond their limits; each vessel with ``decision``,
        and along it ``decision_along``, ``interval_95_um``, ``lower_um`` and ``upper_um`` (limits
        of the diameter); ``judging`` with the features.
        Of a pose in doubt nothing fails (`pose_in_doubt`). Of a design that is the same in several
        poses all of them are tried (`held_in_all`; ``judging.symmetry``).

    Raises
    ------
    ToleranceError
        When the tolerances are of vessels that the network doesn't have.
    KeyError
        When the numbers are an older version's, without designed diameters of the sections.
    """
    ambiguity = numbers.get("ambiguity") or {}
    found = _judged(numbers, tolerances)
    if pose_in_doubt(ambiguity):
        return fails_withdrawn(found)
    same = [one for one in ambiguity.get("rivals", ()) if is_close(one) and one["same"]]
    if not same or not all(one.get("vessels") for one in same):
        return found
    poses = same_poses(ambiguity)
    others = [_judged(renamed(numbers, pose), tolerances) for pose in poses]
    return held_in_all(found, others, poses, [str(one["motion"]) for one in same])


def _judged(numbers: Record, tolerances: Tolerances) -> dict[str, object]:
    """Judge in one pose."""
    rows, rule = numbers["vessels"], tolerances.limits.rule
    kinds = {int(row["vessel"]): str(row["kind"]) for row in rows}
    tolerances.check(kinds)
    zones, of_zones = judged_zones(numbers.get("characteristics", ()), kinds, tolerances)
    before = [
        change
        for d in numbers["defects"]
        if d.get("local", True)
        for change in d.get("changes", (d,))
    ]
    ways = [_way(d, tolerances.of(int(d["vessel"]), _kind(rows, d))) for d in before
            if d["kind"] in _WAYS]  # fmt: skip
    judged = [
        _Vessel(
            row,
            series,
            tolerances.of(int(row["vessel"]), str(row["kind"])),
            before,
            ways,
            [f for f in of_zones if f.vessel == row["vessel"]],
        )
        for row, series in zip(rows, series_of(rows), strict=True)
    ]
    features = [f for vessel in judged for f in vessel.features]
    features += [f for _, f in ways]
    features += [f for f in of_zones if f.vessel is None]
    features.append(_rms(numbers, rule, tolerances.rms_um))
    features += size_features(numbers, tolerances)
    listed = [d for vessel in judged for d in vessel.findings] + [d for d, _ in ways]
    out: dict[str, Any] = json_ready(
        dict(numbers)
        | {
            "vessels": [vessel.row for vessel in judged],
            "characteristics": zones,
            "findings": sorted(listed, key=lambda d: (d["vessel"], d["at_mm"])),
            "judging": {
                "decision_rule": rule.name.value,
                "conformance_level": rule.level,
                "rule": rule.words,
                "false_fail_risk": RISK,
                "tolerances": plain_tolerances(tolerances),
                "decision": worst_decision(f.decision for f in features),
                "features": [_plain(f) for f in features],
            },
        }
    )
    out["defects"] = [finding for finding in out["findings"] if is_defect(finding)]
    return out


def withhold_unsure(
    numbers: dict[str, Any], unsure_mm: Sequence[tuple[tuple[float, float], ...]]
) -> None:
    """Take out of report numbers what counts on an axis that may not follow its lumen.

    Sections, closures and changes within such a stretch, of each vessel's `unsure_mm`, are dropped;
    the vessel is undecided there, neither open nor closed. Ways out of it are doubtful.
    """
    stretches = {
        int(row["vessel"]): one for row, one in zip(numbers["vessels"], unsure_mm, strict=True)
    }
    kept, closed = [], set()
    for defect in numbers["defects"]:
        ends = stretches[int(defect["vessel"])] + stretches.get(defect.get("other"), ())
        if not any(first <= defect["at_mm"] <= last for first, last in ends):
            kept.append(defect)
        elif defect["kind"] in _WAYS:
            kept.append({**defect, "doubt": "axis"})
        elif defect["kind"] in ("occlusion", "missing"):
            closed.add(int(defect["vessel"]))
            numbers["perfusion"] = None
    numbers["defects"] = kept
    still = {int(d["vessel"]) for d in kept if d["kind"] in ("occlusion", "missing")}
    for row in numbers["vessels"]:
        unsure = stretches[int(row["vessel"])]
        if not unsure:
            continue
        along = list(row["along_mm"])
        own = [k for k, at in enumerate(along) if not any(a <= at <= b for a, b in unsure)]
        for key, values in row.items():
            if key in _ALONG and len(values) == len(along):
                row[key] = [values[k] for k in own]
        oval_at = row.get("oval_at_mm")
        if oval_at is not None and any(a <= oval_at <= b for a, b in unsure):
            row["oval_um"] = None
        if 2 * len(own) < len(along):
            row["measured_um"] = row["error_percent"] = None
        row["unsure_mm"] = [list(one) for one in unsure]
        row["open"] = False if int(row["vessel"]) in still else None
    numbers["all_open"] = all(row["open"] is True for row in numbers["vessels"])


def is_defect(finding: Record) -> bool:
    """Whether a finding stands out from its vessel, or is measured beyond its limits.

    The others are sections within their limits that aren't proven to be.
    """
    if finding.get("local", True) or finding.get("decision") == "fail":
        return True
    off, limit = finding.get("deviation_um"), finding.get("tolerance_um")
    return off is not None and limit is not None and not limit[0] <= off <= limit[1]


def judge_plain(
    numbers: Record, tolerance_um: float, diameter_tolerance_percent: float
) -> dict[str, object]:
    """Judge by one RMS limit and one symmetric limit of every diameter, by the rule it had."""
    p = diameter_tolerance_percent
    limits = VesselLimits(Limit(minus_percent=p, plus_percent=p), rule=_rule_of(numbers))
    return judge(numbers, Tolerances(limits, tolerance_um))


def _rule_of(numbers: Record) -> Rule:
    judging = numbers.get("judging", {})
    if "decision_rule" not in judging:
        return Rule()
    return Rule(DecisionRule(judging["decision_rule"]), judging["conformance_level"])


class _Vessel:
    """One vessel's features, findings and row."""

    def __init__(
        self,
        row: Record,
        series: Series,
        limits: VesselLimits,
        defects: Sequence[Record],
        ways: Sequence[tuple[Record, Feature]],
        zones: Sequence[Feature],
    ) -> None:
        own = [d for d in defects if d["vessel"] == row["vessel"] and d["kind"] not in _WAYS]
        band = band_of(series, limits.section, limits.rule)
        closures = [_closure(d, limits) for d in own if d["kind"] in ("occlusion", "missing")]
        self.features: list[Feature] = [
            *section_feature(band, limits),
            *narrowest_feature(band, limits),
            *mean_feature(row, band, limits),
            *oval_feature(row, limits),
            *offset_feature(row, limits),
            *open_features(row, limits, bool(closures)),
            *zones,
        ]
        self.findings = [*closures, *findings(row, band, limits.section, limits.rule, own)]
        self.features += [
            change_feature(one) for one in self.findings if apart_from_sections(band, one)
        ]
        # Features of ways stand once in the print's list; here they count for both ends.
        leaking = [f for d, f in ways if row["vessel"] in (d["vessel"], d.get("other"))]
        decision = worst_decision(f.decision for f in [*self.features, *leaking])
        others = worst_decision(
            f.decision for f in [*self.features, *leaking] if f.name != "section"
        )
        probability = None if math.isnan(band.conformance) else band.conformance
        self.row = {
            **row,
            "decision": decision,
            # Of its diameters; what fails for another reason doesn't conform, whatever those are.
            "conformance": 0.0 if others == "fail" else probability,
            "interval_95_um": np.round(series.u_um, 2).tolist(),
            "lower_um": np.round(series.designed_um - band.below_um, 2).tolist(),
            "upper_um": np.round(series.designed_um + band.above_um, 2).tolist(),
            "decision_along": [ORDER[int(code)] for code in band.code],
        }


def band_of(series: Series, limit: Limit, rule: Rule) -> Band:
    """Decide on the sections of a vessel, and on all of them together."""
    below, above = limit.around(series.designed_um)
    n = int(np.isfinite(series.u_um).sum())
    u_fail = np.fmax(fail_width(series.common_um, series.random_um, n), series.u_um)
    # Of a section without an interval nothing is proven, whatever the others share.
    u_fail = np.where(np.isnan(series.u_um), np.nan, u_fail)
    # A closed section has no noise: it is beyond any lower limit.
    closed = series.measured_um == 0
    u = np.where(closed, 0.0, series.u_um)
    u_fail = np.where(closed, 0.0, u_fail)
    code = decide(rule, series.error_um, u, u_fail, below, above)
    known = np.isfinite(u + series.error_um) & ~closed
    measured = series.error_um[known], series.common_um[known], series.random_um[known]
    each, joint = conformance(*measured, below[known], above[known])
    together = code
    if rule.name is DecisionRule.CONFORMANCE:
        code[known] = codes(rule, each)
        together = np.append(code[~known], codes(rule, np.array([joint])))
    decision = worst_decision(ORDER[k] for k in together)
    probability = 0.0 if closed.any() else joint if known.all() and len(known) else math.nan
    return Band(series, below, above, u_fail, code, probability, decision)


def _closure(defect: Record, limits: VesselLimits) -> dict[str, object]:
    decision: Decision = "fail" if limits.open else "pass"
    return {**defect, "local": True, **BARE, "decision": decision}


def _way(defect: Record, limits: VesselLimits) -> tuple[dict[str, object], Feature]:
    feature = leak_feature(defect, limits)
    judged = {"decision": feature.decision, "u_um": feature.u_um, "limit": feature.limit}
    return {**defect, "local": True, **BARE, **judged}, feature


def _kind(rows: Sequence[Record], defect: Record) -> str:
    return next(str(row["kind"]) for row in rows if row["vessel"] == defect["vessel"])


def _rms(numbers: Record, rule: Rule, limit_um: float) -> Feature:
    """Judge the RMS; reports from before it had an interval are judged by the value."""
    return rms_feature(
        rule, numbers["scaled"]["rms_um"], numbers.get("rms_interval_95_um", 0.0), limit_um
    )


def _plain(feature: Feature) -> dict[str, object]:
    return {key: value for key, value in asdict(feature).items() if value not in (None, "", ())}


def plain_tolerances(tolerances: Tolerances) -> dict[str, object]:
    """Return tolerances as JSON; what isn't limited is left out."""
    return {
        "rms_um": tolerances.rms_um,
        **_finite("rigid_rms_um", tolerances.rigid_limit_um),
        **_finite("size_percent", tolerances.size_percent),
        **_finite("face_profile_um", tolerances.face_profile_um),
        **_limits(tolerances.limits),
        "vessels": [
            {
                "vessels": sorted(one.vessels),
                "kinds": sorted(one.kinds),
                **{key: _value(value) for key, value in one.changes.items()},
            }
            for one in tolerances.overrides
        ],
    }


def _finite(name: str, limit: float) -> dict[str, float]:
    return {name: limit} if math.isfinite(limit) else {}


def _limits(limits: VesselLimits) -> dict[str, object]:
    values = {f.name: _value(getattr(limits, f.name)) for f in fields(limits) if f.name != "rule"}
    return {key: value for key, value in values.items() if value is not None}


def _value(value: Any) -> Any:
    if isinstance(value, Limit):
        return {key: v for key, v in asdict(value).items() if math.isfinite(v)}
    return None if isinstance(value, float) and math.isinf(value) else value


def list_findings(numbers: Record) -> Sequence[Record]:
    """Return all findings of a registration; the defects of one that wasn't judged."""
    findings = numbers.get("findings", numbers.get("defects", ()))
    return findings if isinstance(findings, Sequence) else ()
