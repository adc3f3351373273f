"""Uncertainty budgets as JSON rows: terms, shares of the variance, remedy for the largest."""

from __future__ import annotations

from typing import Any

from registration.alignment.uncertainty.budget import Budget

_REFERENCE = "scan a reference of known diameters (printctl calibrate oct --reference)"
REMEDIES = {
    "speckle": "average more looks: repeat the scan and average, or scan slower",
    "speckle and roughness": "average more looks: repeat the scan and average, or scan slower",
    "shape": "the print deviates over millimetres: no better scan makes it less",
    "level of the wall": _REFERENCE,
    "level of the walls": _REFERENCE,
    "reflections": "scan a reference of known diameters, or tilt the part by a few degrees",
    "place of the walls": _REFERENCE,
    "blur and curvature": "smaller voxels",
    "refractive index": "scan a depth standard (printctl calibrate oct --step, --oct-calibration)",
    "thin gel beside": "smaller voxels, or more gel between lumens",
    "voxel size": "calibrate the scanner's field (printctl calibrate oct --grid)",
}
"""What makes each term smaller."""


def terms(budget: Budget, scale: float) -> list[dict[str, Any]]:
    """Return a budget's terms, standard uncertainties times `scale`, the largest first."""
    return [
        {
            "term": term.name,
            "type": term.kind,
            "standard": _short(scale * term.standard),
            "dof": _short(term.dof),
            "share": _short(budget.share(term)),
            "note": term.note,
        }
        for term in sorted(budget.terms, key=lambda term: -term.standard)
    ]


def quantity(name: str, unit: str, budget: Budget, scale: float) -> dict[str, Any]:
    """Return a quantity's budget with what would reduce it most."""
    rows = terms(budget, scale)
    return {
        "quantity": name,
        "unit": unit,
        "standard": _short(scale * budget.standard),
        "dof": _short(budget.dof),
        "interval_95": _short(scale * budget.expanded),
        "terms": rows,
        "reduce": REMEDIES[rows[0]["term"]],
    }


def _short(value: float) -> float:
    return float(f"{value:.4g}")
