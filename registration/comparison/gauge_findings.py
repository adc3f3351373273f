"""Convert a gauge study's results to sentences, notes, JSON and CSV text."""

from __future__ import annotations

import math
from dataclasses import asdict

from registration.comparison.gauge_shares import ALPHA, NAMES, Share
from registration.comparison.gauge_study import Claim, GaugeQuantity, GaugeStudy
from registration.comparison.statistics import Interval
from registration.files.exports import as_csv
from registration.json_ready import json_object, json_ready

WORDS = {
    "EV": "repeatability",
    "AV": "operators",
    "INT": "parts x operators",
    "GRR": "gauge as a whole",
    "PV": "parts",
    "TV": "total",
}
SOURCES = (
    "Random-effects ANOVA after AIAG MSA, 4th ed. 2010, and ISO 22514-7; intervals 95 %: modified "
    "large sample (Graybill & Wang 1980; Ting et al. 1990; Burdick, Borror & Montgomery 2003), of "
    "shares of the total by generalized inference (Hamada & Weerahandi 2000)"
)
"""Of the numbers."""


def gauge_sentences(study: GaugeStudy) -> list[str]:
    """Return the main results of a gauge study in sentences."""
    sentences = [_design(study)]
    pooled = study.quantity("diameters")
    if pooled is None:
        sentences.append("No vessel was measured in every scan: no figure for all vessels together")
    else:
        sentences += [_gauge(pooled), _interaction(pooled)]
    whole = [claim for claim in study.claims if claim.name == "all vessels"]
    return sentences + [claim_sentence(claim) for claim in whole]


def _design(study: GaugeStudy) -> str:
    counts = sorted({n for row in study.repeats for n in row})
    times = str(counts[0]) if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    return (
        f"Gauge study: {_count(len(study.operators), 'operator')}, "
        f"{_count(len(study.parts), 'part')}, {times} scans of each by each"
    )


def _count(number: int, name: str) -> str:
    return f"{number} {name}{'' if number == 1 else 's'}"


def _gauge(quantity: GaugeQuantity) -> str:
    """Say the figures that a gauge is accepted by."""
    shares = quantity.shares
    ev, grr = shares.sources["EV"], shares.sources["GRR"]
    text = f"A vessel's diameter: repeatability {_interval_text(ev.sd, 'µm')}"
    if quantity.squares.operators > 1:
        text += f", repeatability and operators together (GRR) {_interval_text(grr.sd, 'µm')}"
    if math.isfinite(grr.of_tolerance.value):
        text += f", {_interval_text(grr.of_tolerance, '%')} of the tolerance"
    if math.isfinite(grr.of_total.value):
        text += f", {_interval_text(grr.of_total, '%')} of the total variation; ndc {shares.ndc}"
    return text


def _interaction(quantity: GaugeQuantity) -> str:
    squares = quantity.squares
    if squares.interaction.df < 1:
        what = "one operator" if squares.operators == 1 else "one part"
        return f"Only {what}: nothing is known of the interaction of parts and operators"
    if squares.error.df < 1:
        return "No part was scanned twice by one operator: the interaction counts as repeatability"
    kept = "pooled with the repeats" if squares.pooled else "kept"
    return (
        f"Interaction of parts and operators: p = {squares.p_interaction:.2g}, {kept} (limit "
        f"{ALPHA:g})"
    )


def claim_sentence(claim: Claim) -> str:
    """Say what the budget claims, what repeats show, and what was tested: the mean ratio."""
    if claim.verdict == "unknown":
        return f"{_capital(claim.name)}: no budget with a type A share, so nothing to hold against"
    text = (
        f"{_capital(claim.name)}: the budget claims {claim.claimed_um:.2g} µm, repeats scatter by "
        f"{claim.seen_um:.2g} µm, vessel by vessel by {claim.ratio**0.5:.2g} times their claim "
        f"(p = {claim.p:.2g})"
    )
    if claim.verdict == "agrees":
        return text
    return f"{text}: its type A share is {claim.verdict}"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def gauge_notes(study: GaugeStudy) -> list[str]:
    """What a reader must know before trusting the numbers."""
    made = [f"{SOURCES}."]
    if len(study.operators) == 1:
        made.append(
            "One operator: what operators contribute isn't known; GRR is the repeatability alone."
        )
    elif len(study.operators) < 3:
        made.append("Two operators say little of how operators differ; take three or more.")
    if len(study.parts) == 1:
        made.append("One part: variation of parts, shares of the total and ndc aren't known.")
    if not study.balanced:
        made.append(
            "Unequal numbers of repeats: unweighted cell means were analysed; intervals are "
            "approximate."
        )
    made.append(
        "Only repeats with the part laid anew under the scanner show what a new scan would; type B "
        "terms (walls, index, voxel) are the same in all of them and can't be seen here."
    )
    if study.left_out:
        made.append(
            "Left out: " + "; ".join(f"{name} ({why})" for name, why in study.left_out[:6])
            + ("; and more" if len(study.left_out) > 6 else "") + "."
        )  # fmt: skip
    return made


def gauge_dict(study: GaugeStudy) -> dict[str, object]:
    """JSON-ready numbers; what isn't known is None."""
    plain = {
        "sentences": gauge_sentences(study),
        "notes": gauge_notes(study),
        "operators": list(study.operators),
        "parts": list(study.parts),
        "scans": [
            {"label": label, "operator": study.operators[i], "part": study.parts[j]}
            for label, i, j in zip(study.labels, study.operator_of, study.part_of, strict=True)
        ],
        "repeats": [list(row) for row in study.repeats],
        "alpha_interaction": ALPHA,
        "quantities": [_quantity_dict(q) for q in study.quantities],
        "left_out": [{"name": name, "why": why} for name, why in study.left_out],
        "claims": [{**asdict(c), "verdict": c.verdict} for c in study.claims],
    }
    return json_object(plain)


def _quantity_dict(quantity: GaugeQuantity) -> dict[str, object]:
    s = quantity.squares
    return {
        "name": quantity.name,
        "vessel": quantity.vessel,
        "unit": "µm",
        "tolerance_width_um": quantity.width_um,
        "anova": {
            "repeats": s.repeats,
            **{n: asdict(getattr(s, n)) for n in ("part", "operator", "interaction", "error")},
            "p_part": s.p_part,
            "p_operator": s.p_operator,
            "p_interaction": s.p_interaction,
            "interaction_pooled": s.pooled,
        },
        "sources": {name: asdict(share) for name, share in quantity.shares.sources.items()},
        "ndc": quantity.shares.ndc,
        "ndc_interval_95": quantity.shares.ndc_interval,
    }


def gauge_csv(study: GaugeStudy) -> str:
    """CSV, a quantity and source a row; unknown numbers are empty."""
    rows = [
        json_ready(_row(q, name, q.shares.sources[name]))
        for q in study.quantities
        for name in NAMES
    ]
    return as_csv(rows)


def _row(quantity: GaugeQuantity, name: str, share: Share) -> dict[str, object]:
    return {
        "quantity": quantity.name,
        "vessel": quantity.vessel,
        "source": name,
        "meaning": WORDS[name],
        "sd_um": share.sd.value,
        "sd_low_um": share.sd.low,
        "sd_high_um": share.sd.high,
        "df": share.sd.df,
        "of_total_percent": share.of_total.value,
        "of_total_low_percent": share.of_total.low,
        "of_total_high_percent": share.of_total.high,
        "of_tolerance_percent": share.of_tolerance.value,
        "of_tolerance_low_percent": share.of_tolerance.low,
        "of_tolerance_high_percent": share.of_tolerance.high,
        "ndc": quantity.shares.ndc,
        "interaction_pooled": quantity.squares.pooled,
    }


def _interval_text(interval: Interval, unit: str) -> str:
    return f"{interval.value:.3g} {unit} (95 %: {interval.low:.3g} to {interval.high:.3g})"
