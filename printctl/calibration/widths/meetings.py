"""Bracket the smallest open gap, least joint overlap and longest bridge from a printed pattern."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from printctl.calibration.estimate import Estimate, fit_line
from printctl.calibration.patterns import WrittenPattern
from printctl.calibration.results import Result
from printctl.calibration.widths.result import Replies
from printctl.calibration.writing import MeasuredValue

OPEN: Final = 0.8
"""Of the ways across a gap that must be open for it to be."""


@dataclass(frozen=True)
class _Bounds:
    """Neighbouring values between which the answer changes.

    ``no`` is the nearest value at which it is still no (None if it never is), ``yes`` the first
    from which on it is yes (None if it never is); ``mixed`` whether a yes stands among the no.
    """

    no: float | None
    yes: float | None
    mixed: bool


def _bounds(value: FloatArray, good: np.ndarray, *, rising: bool) -> _Bounds:
    """Of answers that should go from no to yes along rising (or falling) values."""
    order = np.argsort(value if rising else -value)
    value, good = value[order], good[order]
    bad = np.flatnonzero(~good)
    last = int(bad[-1]) if len(bad) else -1
    yes = float(value[last + 1]) if last + 1 < len(value) else None
    return _Bounds(float(value[last]) if last >= 0 else None, yes, bool(good[: last + 1].any()))


def _asked(written: WrittenPattern, replies: Replies) -> FloatArray:
    values = {one.number: one.value for one in written.pattern.questions}
    return np.array([values[number] for number in replies.number.tolist()])


def _interval(name: str, bounds: _Bounds, unit: str) -> dict[str, Estimate]:
    """The first yes, and how near the last no is; nothing where one of them is missing."""
    if bounds.no is None or bounds.yes is None:
        return {}
    low, high = sorted((bounds.no, bounds.yes))
    return {name: Estimate(bounds.yes, low, high, unit)}


def fit_comb(written: WrittenPattern, replies: Replies) -> Result:
    """Smallest gap that stays open, between the widest that closed and the next."""
    gap = _asked(written, replies)
    is_open = replies.part >= OPEN
    bounds = _bounds(gap, is_open, rising=True)
    table = ["gap  commanded  measured  (µm)"]
    for number, asked, seen, part in zip(
        replies.number, gap, replies.reply, replies.part, strict=True
    ):
        state = "open" if part >= OPEN else "closed" if part <= 1 - OPEN else f"{part:.0%} open"
        table.append(f"{number:3}  {asked * 1e3:9.0f}  {seen * 1e3:8.0f}  {state}")
    notes, changes = [], {}
    estimates = _interval("smallest gap that stays open", bounds, "mm")
    if bounds.yes is None:
        notes.append("every gap closed: print wider ones (--gaps); nothing is written")
    else:
        text = f"{bounds.yes:g} mm stayed open"
        if bounds.no is None:
            notes.append("every gap stayed open: the smallest may be smaller still (--gaps)")
        else:
            text += f", {bounds.no:g} mm closed"
            notes.append("the interval is that of the gaps tried, not a 95 % one")
        changes["smallest_gap_mm"] = MeasuredValue(bounds.yes, text)
    if bounds.mixed:
        notes.append(
            "a smaller gap stayed open while a wider one closed: the teeth wander by more than the "
            "gaps differ; look at the picture, print it again"
        )
    if replies.least_mm:
        notes.append(f"gaps below {replies.least_mm * 1e3:.0f} µm can't be seen in this picture")
    wider = gap[is_open] - replies.reply[is_open]
    if len(wider) >= 2:
        fit = fit_line(np.ones((len(wider), 1)), wider, "gaps")
        estimates["teeth wider than commanded by"] = fit.estimate(0, "mm")
    notes.append("of two lines side by side; a gap closed all round (a lumen) may close sooner")
    return Result(estimates, notes, table=table, measured=changes)


def fit_joint(written: WrittenPattern, replies: Replies) -> Result:
    """Least overlap that joins."""
    return _yes_no(
        written,
        replies,
        _Question(
            "least overlap that joins",
            "radii",
            lambda part: part <= 1 - OPEN,
            True,
            ("every joint stayed open", "every joint closed: less overlap may do (--overlaps)"),
            "no key of the ink holds it: choose overlap_radii of an embedded toolpath above it",
        ),
    )


def fit_bridge(written: WrittenPattern, replies: Replies) -> Result:
    """Estimate the longest unsupported bridge from measured spans."""
    return _yes_no(
        written,
        replies,
        _Question(
            "longest span that held",
            "mm",
            lambda part: part >= OPEN,
            False,
            ("no bridge held", "every bridge held: it may reach farther (--spans)"),
            "no key of the ink holds it: it is the design's to know",
        ),
    )


@dataclass(frozen=True)
class _Question:
    """How a pattern of yes and no is told."""

    name: str
    unit: str
    good: Callable[[FloatArray], np.ndarray]
    rising: bool
    ends: tuple[str, str]
    note: str


def _yes_no(written: WrittenPattern, replies: Replies, asked: _Question) -> Result:
    value = _asked(written, replies)
    good = np.asarray(asked.good(replies.part))
    bounds = _bounds(value, good, rising=asked.rising)
    table = [
        f"{number:3}  {at:6g} {asked.unit}  {'yes' if yes else 'no'}"
        for number, at, yes in zip(replies.number, value, good, strict=True)
    ]
    estimates = _interval(asked.name, bounds, asked.unit)
    notes = [] if bounds.yes is not None else [asked.ends[0]]
    if bounds.no is None:
        notes.append(asked.ends[1])
    if bounds.mixed:
        notes.append("the answers aren't in order: one print isn't enough, repeat it")
    if estimates:
        notes.append("the interval is that of the values tried, not a 95 % one")
    return Result(estimates, [*notes, asked.note], table=table)
