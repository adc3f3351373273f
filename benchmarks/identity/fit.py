"""Fit the weights of `registration.measuring.topology.overlap.Likelihood` to kept numbers.

Logistic regression with weights of at least 0 (each term can only speak for another part) and a
small ridge; right and wrong scans count alike. By ten-fold cross-validation each scan is judged by
weights that were fitted without it.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from benchmarks.identity.rows import read_cases
from kernels.arrays import FloatArray
from registration.measuring.topology.overlap import LEAST_LIT, LIKELIHOOD

RIDGE = 0.01
FOLDS = 10
NAMES = ("foreign", "closed", "far", "scale")


def terms(numbers: dict[str, Any]) -> FloatArray | None:
    """Return the terms of one registration; None where it is refused or too dark."""
    if "refused" in numbers or not numbers["lit_share"] >= LEAST_LIT:
        return None
    return LIKELIHOOD.terms(
        numbers["foreign_ratio"],
        numbers["designed_open"],
        numbers["close_share"],
        numbers["scale_off"],
    )


def fitted(values: FloatArray, wrong: FloatArray) -> FloatArray:
    """Return constant and weights of the regression on terms (n, 4), (5,)."""
    size = np.maximum(values.std(axis=0), 1e-9)
    share = np.where(wrong > 0, 0.5 / (wrong > 0).sum(), 0.5 / (wrong <= 0).sum())

    def loss(weights: FloatArray) -> float:
        score = weights[0] + values / size @ weights[1:]
        fit = np.logaddexp(0, np.where(wrong > 0, -score, score)) @ share
        return float(fit + RIDGE * (weights[1:] ** 2).sum())

    bounds = [(None, None)] + [(0.0, None)] * values.shape[1]
    found = minimize(loss, np.zeros(values.shape[1] + 1), bounds=bounds).x
    return np.concatenate([found[:1], found[1:] / size])


def main() -> None:
    """Print the fit of a file's cases and what cross-validation says of it."""
    found = [one for one in read_cases(Path(sys.argv[1])).values() if "unread" not in one]
    both = [
        (terms(one[key]), key == "of_wrong") for one in found for key in ("of_right", "of_wrong")
    ]
    told = [(one, side) for one, side in both if one is not None]
    values, wrong = np.array([one for one, _ in told]), np.array([float(side) for _, side in told])
    fold = np.random.default_rng(0).integers(FOLDS, size=len(values))
    held = np.empty(len(values))
    for k in range(FOLDS):
        weights = fitted(values[fold != k], wrong[fold != k])
        held[fold == k] = weights[0] + values[fold == k] @ weights[1:]
    weights = fitted(values, wrong)
    right, other = held[wrong == 0], held[wrong > 0]
    most = float(right.max())
    print(
        json.dumps(
            {
                "scans": len(found),
                "told": [len(right), len(other)],
                "constant": weights[0],
                **dict(zip(NAMES, weights[1:], strict=True)),
                "right_highest": most,
                "wrong_lowest": np.sort(other)[:10].round(2).tolist(),
                "missed_above_right": float((other <= most).mean()),
            },
            indent=1,
        )
    )


if __name__ == "__main__":
    main()
