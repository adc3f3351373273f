"""Derive order rules of whole writing strokes from those of the vessel elements they write."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.order.schedule import Leg, Pass
from design.toolpath.embedded.rules import Rules, owners
from kernels import jit
from kernels.arrays import IntArray


class PassRules(NamedTuple):
    """Pass p goes before ``after[after_begin[p] : after_begin[p + 1]]``; `before` is its mirror."""

    after_begin: IntArray
    after: IntArray
    before_begin: IntArray
    before: IntArray
    turns: NDArray[np.bool_]  # (p,), whether a pass may be written from its other end


def pass_rules(passes: list[Pass], elements: Elements, rules: Rules) -> PassRules:
    """Rules of elements as those of the passes that write them; none of those that none writes."""
    number = np.full(len(elements.end), -1)
    for k, one in enumerate(passes):
        for leg in one.legs:
            low, high = sorted((leg.element, leg.last))
            number[low : high + 1] = k
    pairs = np.stack([number[owners(rules)], number[rules.after]])
    first, after = pairs[:, (pairs >= 0).all(axis=0)]
    return _of_pairs(first, after, np.ones(len(passes), dtype=np.bool_))


def contracted(graph: PassRules, number: IntArray) -> PassRules:
    """Rules of passes made from those of a graph; ``number`` (p,) of the one each has gone into."""
    turns = np.ones(int(number.max()) + 1, dtype=np.bool_)
    turns[number[~graph.turns]] = False
    return _of_pairs(np.repeat(number, np.diff(graph.after_begin)), number[graph.after], turns)


def _of_pairs(first: IntArray, after: IntArray, turns: NDArray[np.bool_]) -> PassRules:
    """Rules from pairs, and which of the passes may turn; one with a rule within itself may not."""
    turns[first[first == after]] = False
    count = len(turns)
    return PassRules(*_grouped(first, after, count), *_grouped(after, first, count), turns)


@jit
def _grouped(one: IntArray, other: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Of each `one` where its `other` begin, and those of all in a row; without repeats.

    Two sorts by counting: by `other`, then by `one`.
    """
    rows = _counted(one, other, np.arange(len(one)), count)
    rows = _counted(other, one, rows, count)
    begin, members, total = np.zeros(count + 1, dtype=np.int64), np.empty_like(rows), 0
    last = -1
    for row in rows:
        key = one[row] * count + other[row]
        if key != last:
            members[total] = other[row]
            total += 1
            begin[one[row] + 1] += 1
        last = key
    return np.cumsum(begin), members[:total].copy()


@jit
def _counted(one: IntArray, other: IntArray, rows: IntArray, count: int) -> IntArray:
    """Rows sorted by `other`, in their order where it is the same; none of one pass alone."""
    place = np.zeros(count + 1, dtype=np.int64)
    kept = 0
    for row in rows:
        if one[row] != other[row]:
            place[other[row] + 1] += 1
            kept += 1
    place = np.cumsum(place)
    ordered = np.empty(kept, dtype=np.int64)
    for row in rows:
        if one[row] != other[row]:
            ordered[place[other[row]]] = row
            place[other[row]] += 1
    return ordered


def pass_ends(one: Pass, elements: Elements) -> tuple[int, int]:
    """First and last point of a pass."""
    start, last = one.legs[0], one.legs[-1]
    here = elements.end[start.element, 0 if start.step > 0 else 1]
    there = elements.end[last.last, 1 if last.step > 0 else 0]
    return int(here), int(there)


def reverse_pass(one: Pass) -> Pass:
    """The same from its other end."""
    return Pass(tuple(Leg(leg.last, -leg.step, leg.size) for leg in one.legs[::-1]))
