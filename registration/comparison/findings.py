"""Turn a comparison of several prints into a verdict, notes, JSON and CSV."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from registration.comparison.compare import Comparison
from registration.comparison.gauge_findings import gauge_dict, gauge_sentences
from registration.comparison.statistics import Interval, sd_factors
from registration.comparison.vessels import SIGNIFICANT, VesselSpread
from registration.files.exports import as_csv
from registration.json_ready import Verdict, json_object, json_ready

FEW = 10
"""Prints below which the notes say what so few are worth."""


def verdict(comparison: Comparison) -> Verdict:
    """``passed`` (None where no print has a verdict), ``undecided``, and reasons in sentences."""
    known = [p for p in comparison.prints if p.passed is not None]
    short = [p for p in known if not p.passed]
    return {
        "passed": not short if known else None,
        "undecided": bool(short) and all(p.undecided for p in short),
        "reasons": sentences(comparison),
    }


def sentences(comparison: Comparison) -> list[str]:
    """What a reader wants to know first."""
    return [
        _history(comparison),
        _centre(comparison),
        _spread(comparison),
        _standing_out(comparison),
        _drift(comparison),
        _defects(comparison),
        *([] if comparison.gauge is None else gauge_sentences(comparison.gauge)),
    ]


def _history(comparison: Comparison) -> str:
    known = [p for p in comparison.prints if p.passed is not None]
    if not known:
        return f"{len(comparison.prints)} prints, none with a verdict"
    failed = [p.label for p in known if not p.passed and not p.undecided]
    undecided = [p.label for p in known if p.undecided]
    text = f"{sum(p.passed is True for p in known)} of {len(known)} prints pass"
    if len(known) < len(comparison.prints):
        text += f" ({len(comparison.prints) - len(known)} more have no verdict)"
    if failed:
        text += f"; failed: {_some(failed)}"
    return text + (f"; undecided: {_some(undecided)}" if undecided else "")


def _centre(comparison: Comparison) -> str:
    mean = comparison.quantity("mean_diameter_error").parts.mean
    if not math.isfinite(mean.value):
        return "No vessel was measured in every scan, so there is no mean diameter error"
    return f"Diameters are off by {_interval_text(mean, 'µm', True)} on average"


def _spread(comparison: Comparison) -> str:
    pooled = comparison.repeatability
    if len(comparison.prints) < 2:
        return "One print alone: nothing is known of how prints differ"
    if pooled.observed_sd.df < 1:
        return "No vessel was measured in every scan, so there is no spread common to all"
    observed = _interval_text(pooled.observed_sd, "µm")
    text = f"A vessel's diameter varies from print to print by {observed} SD"
    if pooled.scan_sd.df < 1:
        return text + ", scan noise included (no print was scanned twice)"
    return (
        f"{text}; scans of one print by {_interval_text(pooled.scan_sd, 'µm')}, which leaves "
        f"{_interval_text(pooled.print_sd, 'µm')} to the prints"
    )


def _standing_out(comparison: Comparison) -> str:
    off = [str(v.vessel) for v in comparison.vessels if v.off]
    varies = [str(v.vessel) for v in comparison.vessels if v.varies]
    if not off and not varies:
        return "No vessel is off in every print, or varies more than the others, beyond chance"
    texts = [
        f"{len(names)} of {len(comparison.vessels)} vessels {what}: {_some(names)}"
        for names, what in ((off, "off in every print alike"), (varies, "varying more than others"))
        if names
    ]
    return "; ".join(texts)


def _drift(comparison: Comparison) -> str:
    drawn = [(q, q.per_print) for q in comparison.quantities if q.per_print is not None]
    if not drawn:
        return "Drift: needs three prints"
    moving = [f"{q.name.replace('_', ' ')} by {_interval_text(t.slope, q.unit, True)} a print"
              for q, t in drawn if q.p_drift < SIGNIFICANT]  # fmt: skip
    vessels = [str(v.vessel) for v in comparison.vessels if v.p_drift < SIGNIFICANT]
    if vessels:
        moving.append(f"the diameter of vessels {_some(vessels)}")
    return "Drifts: " + "; ".join(moving) if moving else "No drift beyond chance"


def _defects(comparison: Comparison) -> str:
    common = [d for d in comparison.defects if d.common]
    if not comparison.defects:
        return "No defects"
    count = len(comparison.prints)
    places = ", ".join(
        f"{d.kind} in vessel {d.vessel} ({len(d.prints)} of {count})" for d in common[:4]
    )
    single = len(comparison.defects) - len(common)
    text = f"{len(common)} defect{'s' if len(common) != 1 else ''} common to several prints"
    return f"{text}{f': {places}' if places else ''}; {single} in one print alone"


def notes(comparison: Comparison) -> list[str]:
    """What a reader must know before trusting the numbers."""
    result = []
    count = len(comparison.prints)
    if 2 <= count < FEW:
        low, high = sd_factors(count - 1)
        better = sd_factors(FEW - 1)
        result.append(
            f"{count} prints are few: a standard deviation from them may be {low:.2f} to "
            f"{high:.3g} times what is given (from {FEW}: {better[0]:.2f} to {better[1]:.2f})."
        )
    repeated = [p for p in comparison.prints if len(p.scans) > 1]
    if repeated:
        groups = "; ".join(", ".join(comparison.scans[k].label for k in p.scans) for p in repeated)
        result.append(f"Taken for scans of one print: {groups}.")
    if not comparison.by_time:
        result.append(
            "Prints stand in the order in which they were named: not all say when they were made."
        )
    result.append(
        "The segmentation moves all walls alike by some µm, which no number of prints averages "
        "out: an error that all vessels share may be the scan's. What a vessel is off beyond the "
        "others isn't."
    )
    return result


def comparison_dict(comparison: Comparison) -> dict[str, Any]:
    """JSON-ready numbers; what isn't known or finite is None. Prints and vessels from 0."""
    plain = {
        "schema": 1,
        "verdict": verdict(comparison),
        "design": {"network_sha256": comparison.scans[0].design},
        "by_time": comparison.by_time,
        "diameter_tolerance_percent": comparison.tolerance_percent,
        "prints": [asdict(p) for p in comparison.prints],
        "scans": [
            {"label": s.label, "passed": s.passed, "reasons": s.reasons,
             "error_um": s.error_um.tolist(), "rms_um": s.rms_um, "rigid_rms_um": s.rigid_rms_um}
            for s in comparison.scans
        ],
        "quantities": {q.name: asdict(q) for q in comparison.quantities},
        "repeatability": asdict(comparison.repeatability),
        "vessels": [{**asdict(v), "off": v.off, "varies": v.varies} for v in comparison.vessels],
        "defects": [{**asdict(d), "common": d.common} for d in comparison.defects],
        "gauge": None if comparison.gauge is None else gauge_dict(comparison.gauge),
        "notes": notes(comparison),
    }  # fmt: skip
    return json_object(plain)


def _interval_text(interval: Interval, unit: str, signed: bool = False) -> str:
    """``−3.1 µm (−5 to −1)``."""
    form = "+.2f" if signed else ".2f"
    value = f"{interval.value:{form}} {unit}"
    if math.isfinite(interval.low):
        value += f" (95 %: {interval.low:{form}} to {interval.high:{form}})"
    return value.replace("-", "\N{MINUS SIGN}")


def _some(names: list[str]) -> str:
    return ", ".join(names[:8]) + (" …" if len(names) > 8 else "")


def comparison_csv(comparison: Comparison) -> str:
    """CSV; unknown numbers are empty. The last columns are each scan's error, in order."""
    return as_csv([json_ready(vessel_row(comparison, v)) for v in comparison.vessels])


def vessel_row(comparison: Comparison, vessel: VesselSpread) -> dict[str, object]:
    """One vessel's numbers, flat."""
    error = vessel.error
    able = vessel.capability
    return {
        "vessel": vessel.vessel,
        "designed_um": vessel.designed_um,
        "prints": error.prints,
        "open": vessel.open,
        "known": vessel.known,
        **_flat("mean_error", error.mean),
        **_flat("observed_sd", error.observed_sd),
        **_flat("scan_sd", error.scan_sd),
        **_flat("print_sd", error.print_sd),
        "along_sd_um": vessel.along_sd_um,
        "profile_sd_um": vessel.profile_sd_um,
        "p_off": vessel.p_off,
        "p_beyond_others": vessel.p_beyond,
        "p_varies": vessel.p_varies,
        "drift_um_per_print": vessel.drift.slope.value if vessel.drift else None,
        "p_drift": vessel.p_drift,
        "off": vessel.off,
        "varies": vessel.varies,
        **({} if able is None else _flat("cp", able.cp, "") | _flat("cpk", able.cpk, "")),
        **{f"error_{k + 1}_um": float(scan.error_um[vessel.vessel])
           for k, scan in enumerate(comparison.scans)},
    }  # fmt: skip


def _flat(name: str, interval: Interval, unit: str = "_um") -> dict[str, float]:
    return {
        f"{name}{unit}": interval.value,
        f"{name}_low{unit}": interval.low,
        f"{name}_high{unit}": interval.high,
    }
