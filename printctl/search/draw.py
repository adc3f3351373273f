"""Draw a search's parameter values: full grid, random, Sobol or Latin hypercube samples."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np

from kernels.arrays import FloatArray
from printctl.errors import RecipeError
from printctl.search.model import MOST, Range, SearchFile


def drawn(search: SearchFile) -> list[dict[str, Any]]:
    """Key to value for each candidate, in their order; the same for the same file and seed.

    Of a grid the last key's values vary fastest. What is drawn twice counts once.

    Raises
    ------
    RecipeError
        For a grid of too many.
    """
    rows = _grid(search) if search.draw == "grid" else _sampled(search)
    by_text: dict[str, dict[str, Any]] = {}
    for row in rows:
        values = dict(zip(search.vary, row, strict=True))
        by_text.setdefault(repr(values), values)
    return list(by_text.values())


def _grid(search: SearchFile) -> list[tuple[Any, ...]]:
    axes = [_steps(one) if isinstance(one, Range) else list(one) for one in search.vary.values()]
    count = math.prod(len(axis) for axis in axes)
    if count > MOST:
        raise RecipeError(
            f"vary: the grid has {count:,} candidates, {MOST:,} at most; vary less, or draw some "
            "of them (draw: latin_hypercube, count: 200)"
        )
    return list(product(*axes))


def _steps(one: Range) -> list[float | int]:
    count = one.steps or 2
    shares = (k / (count - 1) for k in range(count))
    if one.whole:
        between = [_between(one, share) for share in shares]
        return list(dict.fromkeys(round(value) for value in between))
    return [_shown(one, share) for share in shares]


def _sampled(search: SearchFile) -> list[tuple[Any, ...]]:
    cube = _unit_cube(search)
    return [
        tuple(_value(one, share) for one, share in zip(search.vary.values(), row, strict=True))
        for row in cube.tolist()
    ]


def _unit_cube(search: SearchFile) -> FloatArray:
    """Points in [0, 1), (count, keys)."""
    # Imported here: it takes longer than all the rest of a small search's drawing.
    from scipy.stats import qmc

    random, count, size = np.random.default_rng(search.seed), search.count or 1, len(search.vary)
    if search.draw == "random":
        return random.random((count, size))
    if search.draw == "sobol":
        # Points are balanced in powers of two: the next one is drawn, and cut.
        power = math.ceil(math.log2(count)) if count > 1 else 0
        points = qmc.Sobol(size, rng=random).random_base2(power)[:count]
        return np.asarray(points, dtype=np.float64)
    return np.asarray(qmc.LatinHypercube(size, rng=random).random(count), dtype=np.float64)


def _value(one: tuple[Any, ...] | Range, share: float) -> Any:
    """The value at ``share`` (0 to 1) of what a key may be."""
    if not isinstance(one, Range):
        return one[min(int(share * len(one)), len(one) - 1)]
    if one.whole:
        # Half a step wider at both ends, so that the ends come as often as the others.
        wide = Range.model_construct(low=one.low - 0.5, high=one.high + 0.5, log=one.log)
        return int(min(max(round(_between(wide, share)), one.low), one.high))
    return _shown(one, share)


def _between(one: Range, share: float) -> float:
    if one.log:
        return math.exp((1 - share) * math.log(one.low) + share * math.log(one.high))
    return (1 - share) * one.low + share * one.high


def _shown(one: Range, share: float) -> float:
    """Six digits: what a table shows is what a recipe gets."""
    value = float(f"{_between(one, share):.6g}")
    return min(max(value, one.low), one.high)
