"""Rank a search's candidates: limits first, then a weighted score; find the Pareto fronts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from kernels.arrays import FloatArray, IntArray
from printctl.search.candidates import Candidate
from printctl.search.model import SearchFile
from printctl.search.quantities import QUANTITIES

State = Literal["good", "beyond limits", "undefined", "refused"]
_UNSCORED: tuple[float | None, int | None] = (None, None)
_ORDER: tuple[State, ...] = ("good", "beyond limits", "undefined", "refused")


@dataclass(frozen=True)
class RankedCandidate:
    """Candidate with its rank.

    Attributes
    ----------
    rank : int
        From 1.
    candidate : Candidate
    state : State
        ``good`` keeps all limits; ``undefined`` has no number for an objective (the spread of a
        single terminal's flow); ``refused`` couldn't be grown.
    numbers : mapping of str to number or None
        All that was measured; empty where it was refused.
    score : float or None
        Weighted mean over the goals of where it lies between the best (0) and the worst (1) of
        the good ones; None but for these.
    front : int or None
        1 where no good candidate is as good in all goals and better in one; 2 where that holds
        once those of 1 are taken away, and so on.
    said : str
        Why it isn't good.
    """

    rank: int
    candidate: Candidate
    state: State
    numbers: Mapping[str, float | None]
    score: float | None
    front: int | None
    said: str


def ranked(
    search: SearchFile, results: Sequence[tuple[Candidate, Mapping[str, Any]]]
) -> list[RankedCandidate]:
    """The candidates in order, the best first; of equals the one drawn first.

    The score weighs goals of different units against each other by how far they range among the
    good candidates; those beyond a limit follow in the order of how far beyond they are.

    Parameters
    ----------
    search : SearchFile
    results : sequence of (candidate, what `evaluate` gave)
    """
    rows = [_judged(search, candidate, result) for candidate, result in results]
    good = [row for row in rows if row.state == "good"]
    losses = _losses(search, good)
    scores, fronts = _scores(search, losses), pareto_fronts(losses)
    scored: dict[str, tuple[float | None, int | None]] = {
        row.key: (float(score), int(front))
        for row, score, front in zip(good, scores, fronts, strict=True)
    }

    def place(row: _Row) -> tuple[int, float, int, int]:
        score, front = scored.get(row.key, _UNSCORED)
        how_bad = row.beyond if score is None else score
        return _ORDER.index(row.state), how_bad, front or 0, row.candidate.number

    order = enumerate(sorted(rows, key=place), 1)
    return [_ranked(rank, row, *scored.get(row.key, _UNSCORED)) for rank, row in order]


@dataclass(frozen=True)
class _Row:
    candidate: Candidate
    state: State
    numbers: Mapping[str, float | None]
    beyond: float
    said: str

    @property
    def key(self) -> str:
        return self.candidate.key


def _ranked(rank: int, row: _Row, score: float | None, front: int | None) -> RankedCandidate:
    return RankedCandidate(rank, row.candidate, row.state, row.numbers, score, front, row.said)


def _judged(search: SearchFile, candidate: Candidate, result: Mapping[str, Any]) -> _Row:
    if "refused" in result:
        return _Row(candidate, "refused", {}, 0.0, result["refused"])
    numbers = result["numbers"]
    missing = [name for name in search.objectives if numbers[name] is None]
    if missing:
        text = f"{', '.join(missing)} {'has' if len(missing) == 1 else 'have'} no meaning here"
        return _Row(candidate, "undefined", numbers, 0.0, text)
    over = {
        name: one.beyond(round_to_grain(name, numbers)) for name, one in search.objectives.items()
    }
    broken = [f"{name} {numbers[name]:.4g}" for name, by in over.items() if by > 0]
    state: State = "beyond limits" if broken else "good"
    return _Row(candidate, state, numbers, sum(over.values()), ", ".join(broken))


def round_to_grain(name: str, numbers: Mapping[str, float | None]) -> float:
    """A quantity as it counts: to its grain, so that rounding decides nothing."""
    value, grain = numbers[name], QUANTITIES[name].grain
    if value is None:
        return float("nan")
    return round(value / grain) * grain if grain else value


def _losses(search: SearchFile, good: Sequence[_Row]) -> FloatArray:
    """What each goal costs, (n, goals): the less the better."""
    signs = {name: -1.0 if one.goal == "maximise" else 1.0 for name, one in search.goals.items()}
    rows = [
        [sign * round_to_grain(name, row.numbers) for name, sign in signs.items()] for row in good
    ]
    return np.array(rows, dtype=np.float64).reshape(len(good), len(signs))


def _scores(search: SearchFile, losses: FloatArray) -> FloatArray:
    """Weighted means of shares between best and worst, (n,)."""
    if not len(losses):
        return np.empty(0)
    weight = np.array([one.weight for one in search.goals.values()])
    low, wide = losses.min(axis=0), np.ptp(losses, axis=0)
    share = np.divide(losses - low, wide, out=np.zeros_like(losses), where=wide > 0)
    return np.asarray((share * weight).sum(axis=1) / weight.sum())


def pareto_fronts(losses: FloatArray) -> IntArray:
    """Number of each row's front, from 1, (n,).

    Parameters
    ----------
    losses : (n, goals) float64
        The less the better.
    """
    front = np.zeros(len(losses), dtype=np.int64)
    left, number = np.arange(len(losses)), 0
    while len(left):
        number += 1
        beaten = np.array([_is_beaten(losses[left], row) for row in losses[left]])
        front[left[~beaten]] = number
        left = left[beaten]
    return front


def _is_beaten(losses: FloatArray, row: FloatArray) -> bool:
    """Whether some other is as good in all and better in one."""
    as_good, better = (losses <= row).all(axis=1), (losses < row).any(axis=1)
    return bool((as_good & better).any())
