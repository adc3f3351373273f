"""A layer whose ink lies aside as a whole is told as moved, and nothing of it as missing."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from printctl.observe.judging import shift_of
from printctl.observe.shown_place import seen_where_ink_shows
from registration.inspection import SeeingOptions, Shift


@dataclass(frozen=True)
class Found:
    """What is found within one reach."""

    shift: Shift
    coverage: float
    seen_share: float = 1.0
    aside: bool = False
    ink_mm: float = 2.0
    gaps: tuple[int, ...] = ()
    normal: tuple[float, float] = (0.0, 1.0)
    unseen: int = 0
    first: int = 0

    @property
    def stations(self) -> SimpleNamespace:
        """Ten of 0.2 mm; the last one lacks what isn't there."""
        one = np.ones(10)
        shown = np.arange(10)
        present = np.append(one[1:], 1.0 - (2.0 - self.ink_mm) / 0.2)
        along = 0.2 * np.arange(10)
        return SimpleNamespace(
            stroke=0 * one, along_mm=along, length_mm=0.2 * one, present=present,
            seen=(shown < 10 - self.unseen) & (shown >= self.first),
            normal=np.tile(self.normal, (10, 1)),
            at_mm=np.column_stack([0 * along, along]),
        )  # fmt: skip


def looked(
    by_reach: dict[float, tuple[float, float, float]], lone: bool = True
) -> tuple[float, float, bool, list[float]]:
    """Move, its uncertainty, whether aside; of moves, uncertainties and coverages by reach."""
    asked = []

    def see(options: SeeingOptions) -> Found:
        asked.append(options.shift_mm)
        moved, u, coverage = by_reach[options.shift_mm]
        return Found(Shift(0.0, moved, u**2 * np.eye(2)), coverage)

    found = seen_where_ink_shows(cast(Any, see), SeeingOptions(shift_mm=0.5), 0.1, lone)
    return *shift_of(found), found.aside, asked


@pytest.mark.parametrize("within", [0.3, float("nan")])
def test_ink_that_lies_aside_as_a_whole_is_moved_however_unsure_by_how_much(within: float) -> None:
    reaches = {0.5: (0.3, 0.29, 0.98), 0.1: (0.0, 0.1, within), 1.0: (0, 0, 0)}
    moved, u, aside, asked = looked(reaches)
    assert (moved, u, aside) == (0.3, 0.29, True)
    assert asked[:2] == [0.5, 0.1]


@pytest.mark.parametrize(
    ("by_reach", "lone"),
    [
        ({0.5: (0.3, 0.29, 0.98), 0.1: (0.0, 0.1, 0.3)}, False),  # it may be the older layer
        ({0.5: (0.3, 0.29, 0.98), 0.1: (0.0, 0.1, 0.8)}, True),  # a lone line whose end is missing
        ({0.5: (0.0, 0.5, 0.1), 0.1: (0.0, 0.1, 0.2), 1.0: (0.7, 0.1, 0.4)}, True),  # a clog
    ],
)
def test_missing_ink_is_no_move(
    by_reach: dict[float, tuple[float, float, float]], lone: bool
) -> None:
    moved, _, aside, _ = looked(by_reach, lone)
    assert (moved, aside) == (0.0, False)


@pytest.mark.parametrize(
    ("gaps", "ink_mm", "aside"), [((), 1.8, True), ((1,), 1.8, False), ((), 1.99, False)]
)
def test_a_line_that_is_as_long_as_it_should_be_is_moved_along_itself(gaps, ink_mm, aside):
    """A vessel moved by 0.3 mm along itself went on; one that lacks an end has less ink."""

    def see(options: SeeingOptions) -> Found:
        if options.shift_mm < 0.5:
            return Found(Shift(0.0, 0.1, 0.01 * np.eye(2)), 0.93, ink_mm=ink_mm)
        return Found(Shift(0.0, 0.3, 0.01 * np.eye(2)), 0.98, gaps=gaps)

    found = seen_where_ink_shows(cast(Any, see), SeeingOptions(shift_mm=0.5), 0.1)
    assert found.aside is aside
    assert found.coverage == (0.98 if aside else 0.93)


@pytest.mark.parametrize(("unseen", "aside"), [(0, True), (2, False)])
def test_a_move_along_lines_tells_nothing_where_its_leading_end_is_not_seen(unseen, aside):
    """A clog at the end of a steep part, whose begin lies in older ink, was told as lost steps."""

    def see(options: SeeingOptions) -> Found:
        if options.shift_mm < 0.5:
            return Found(Shift(0.0, 0.0, 0.01 * np.eye(2)), 0.6, ink_mm=1.6, normal=(1.0, 0.0))
        sure = Shift(0.0, 0.4, 1e-4 * np.eye(2))
        return Found(sure, 0.99, normal=(1.0, 0.0), unseen=unseen)

    found = seen_where_ink_shows(cast(Any, see), SeeingOptions(shift_mm=0.5), 0.1)
    assert found.aside is aside
    assert found.coverage == (0.99 if aside else 0.6)


@pytest.mark.parametrize(("first", "aside"), [(1, False), (0, True)])
def test_ends_that_hardly_show_tell_no_move(first: int, aside: bool) -> None:
    """Of a round double wall one place of four showed at its ends, and none within tolerance."""

    def see(options: SeeingOptions) -> Found:
        unsure = Shift(0.0, 0.3, 0.1**2 * np.eye(2))
        if options.shift_mm < 0.5:
            hidden = {"unseen": 2, "first": 2} if first else {"ink_mm": 1.8}
            return Found(Shift(0.0, 0.0, 0.01 * np.eye(2)), 0.98, **cast(Any, hidden))
        return Found(unsure, 0.98, first=first, unseen=2 * first)

    found = seen_where_ink_shows(cast(Any, see), SeeingOptions(shift_mm=0.5), 0.1)
    assert found.aside is aside
