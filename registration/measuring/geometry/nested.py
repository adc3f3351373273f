"""Solve datum equations in order, each within the motions left free by those before (ISO 5459)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray

LEAST_HOLD = 0.02
"""Share of its full hold below which a datum doesn't hold a freedom."""
_NAMED = 0.99


@dataclass(frozen=True)
class Rows:
    """What one datum asks of a twist ξ (6,): ``matrix`` ξ = ``asked``.

    Attributes
    ----------
    matrix : (k, 6) float64
        Of turn (mm a rad) and shift.
    asked : (k,) float64, mm
    pulls : (g, k) float64, mm
        Change of `asked` by one standard deviation of each independent error.
    strained : (s, k) float64, mm
        The same by each stretch of the whole scan.
    """

    matrix: FloatArray
    asked: FloatArray
    pulls: FloatArray
    strained: FloatArray


@dataclass(frozen=True)
class DatumTwist:
    """Twist that brings the datums to their places, and what they leave free.

    Attributes
    ----------
    twist : (6,) float64
    free : (6, f) float64
        Twists that no datum holds.
    pulls : (g, 6) float64
    strained : (s, 6) float64
    """

    twist: FloatArray
    free: FloatArray
    pulls: FloatArray
    strained: FloatArray


def hold(stages: Sequence[Rows], reach_mm: float) -> DatumTwist:
    """Solve the datums in their order: each only moves what those before it left free.

    Parameters
    ----------
    stages : sequence of Rows
        Primary, secondary, tertiary.
    reach_mm : float, mm
        Half of the part's size: a turn counts by what it moves there.
    """
    scale = np.concatenate([np.full(3, 1 / reach_mm), np.ones(3)])
    free = np.diag(scale)
    twist = np.zeros(6)
    answers: list[FloatArray] = []  # (6, k) each: twist per what a stage is asked
    for rows in stages:
        u, size, vt = np.linalg.svd(rows.matrix @ free)
        rank = int((size > LEAST_HOLD).sum())
        inverse = free @ vt[:rank].T @ (u[:, :rank].T / size[:rank, None])
        answers = [old - inverse @ (rows.matrix @ old) for old in answers]
        answers.append(inverse)
        twist = twist + inverse @ (rows.asked - rows.matrix @ twist)
        free = free @ vt[rank:].T
    strained = sum(rows.strained @ one.T for rows, one in zip(stages, answers, strict=True))
    pulls = [rows.pulls @ one.T for rows, one in zip(stages, answers, strict=True)]
    return DatumTwist(twist, free, np.vstack(pulls), np.asarray(strained))


def free_words(free: FloatArray) -> list[str]:
    """Say which motions (6, f) are left: "shift along x", "turn about z"."""
    if not free.shape[1]:
        return []
    _, size, vt = np.linalg.svd(free[:3])
    size = np.concatenate([size, np.zeros(free.shape[1] - len(size))])
    still = size < 1e-6 * max(float(size.max()), 1.0)
    shifts = free[3:] @ vt[still].T
    turns = free[:3] @ vt[~still].T
    return [f"shift along {way}" for way in _ways(shifts)] + [
        f"turn about {way}" for way in _ways(turns)
    ]


def _ways(vectors: FloatArray) -> list[str]:
    """Names of the directions that (3, k) vectors span."""
    if not vectors.shape[1]:
        return []
    u, size, _ = np.linalg.svd(vectors, full_matrices=False)
    span = u[:, size > 1e-6 * size.max()]
    named = [k for k in range(3) if np.linalg.norm(span[k]) > _NAMED]
    if len(named) >= span.shape[1]:
        return ["xyz"[k] for k in named[: span.shape[1]]]
    rest = span - sum((np.outer(np.eye(3)[k], span[k]) for k in named), start=np.zeros_like(span))
    u, _, _ = np.linalg.svd(rest, full_matrices=False)
    others = u[:, : span.shape[1] - len(named)].T
    return ["xyz"[k] for k in named] + [_vector(v) for v in others]


def _vector(way: FloatArray) -> str:
    text = ", ".join(f"{v:.2f}" for v in way + 0.0)
    return f"({text})".replace("-", "\N{MINUS SIGN}")
