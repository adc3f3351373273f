"""Waiting for the bath to close behind the needle before writing across its path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.toolpath import MoveKind, Toolpath
from design.toolpath.embedded import EmbeddedOptions, plan_embedded
from tests.design.toolpath.shapes import random_tree

OPTIONS = EmbeddedOptions(open_joints=99)


def youngest_wake(path: Toolpath, radius_mm: float) -> float:
    """Age of the freshest wake of another pass in which ink is written, s: a slow check.

    The way down to a pass is its own.
    """
    lasts = path.duration_s.copy()
    moving = path.speed_mm_s > 0
    lasts[moving] = path.lengths[moving] / path.speed_mm_s[moving]
    clock = np.concatenate([[0.0], np.cumsum(lasts)])
    number, seen, down = 0, [], []
    for k in range(len(path)):
        way = path.end[k] - path.start[k]
        if path.kind[k] == MoveKind.TRAVEL and way[2] < 0 and not way[:2].any():
            down.append(k)
        if path.kind[k] == MoveKind.TRAVEL and k + 1 < len(path):
            ahead = path.kind[k + 1 :]
            works = np.flatnonzero((ahead == MoveKind.WRITE) | (ahead == MoveKind.TRAVEL))
            if len(works) and ahead[works[0]] == MoveKind.WRITE:
                number += 1
        for share in np.linspace(0, 1, 1 + max(1, int(path.lengths[k] / 0.05))):
            at = path.start[k] + share * way
            owner = number if path.kind[k] != MoveKind.TRAVEL else -1
            writes = path.kind[k] == MoveKind.WRITE
            seen.append((*at, clock[k] + share * lasts[k], owner, k, writes))
    rows = np.array(seen)
    youngest = np.inf
    for row in rows[rows[:, 6] > 0]:
        past = rows[(rows[:, 3] < row[3]) & (rows[:, 4] != row[4]) & (rows[:, 3] > row[3] - 60)]
        past = past[~np.isin(past[:, 5], _own_descent(path, int(row[5]), down))]
        near = np.hypot(past[:, 0] - row[0], past[:, 1] - row[1]) < 0.9 * radius_mm
        near &= past[:, 2] < row[2]
        if near.any():
            youngest = min(youngest, float(row[3] - past[near, 3].max()))
    return youngest


def _own_descent(path: Toolpath, move: int, down: list[int]) -> list[int]:
    first = move
    while first > 0 and path.kind[first - 1] != MoveKind.TRAVEL:
        first -= 1
    found = []
    while first - 1 in down or (first > 0 and path.kind[first - 1] == MoveKind.DWELL):
        first -= 1
        found.append(first)
    return found


@pytest.mark.parametrize("seed", [1, 4])
def test_no_ink_is_laid_in_a_younger_wake(seed: int) -> None:
    net = random_tree(6, 8.0, seed, 0.12)
    plain = plan_embedded(net, OPTIONS).toolpath
    assert youngest_wake(plain, OPTIONS.shaft_mm) < 4.0
    plan = plan_embedded(net, replace(OPTIONS, recovery_s=4.0))
    assert youngest_wake(plan.toolpath, OPTIONS.shaft_mm) >= 4.0 - 0.1
    assert plan.report.waited_s > 0
    moves = plan.toolpath.kind != MoveKind.DWELL
    assert np.array_equal(plan.toolpath.end[moves], plain.end[plain.kind != MoveKind.DWELL])


def test_needle_waits_above_the_pass_and_not_in_the_old_wake() -> None:
    plan = plan_embedded(random_tree(6, 8.0, 1, 0.12), replace(OPTIONS, recovery_s=30.0))
    path = plan.toolpath
    dwells = np.flatnonzero(path.kind == MoveKind.DWELL)
    assert len(dwells)
    for row in dwells:
        write = row + int(np.flatnonzero(path.kind[row:] == MoveKind.WRITE)[0])
        assert path.start[row, 2] > path.start[write, 2]
        assert np.allclose(path.start[row, :2], path.start[write, :2])
        assert path.kind[row + 1] == MoveKind.TRAVEL
