"""A layer's shift is believed where its ink shows it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from printctl.machine.link.marks import Marks
from printctl.observe.devices import DeviceError
from printctl.observe.held_look import (
    HeldLook,
    hidden_stretches,
    slab,
    unseen_paths,
)
from printctl.observe.looking_at import ObservedJob
from registration.inspection import Gap, LayerFindings, Stations, Unseen


def stations_of(along, seen, why=None):
    """Stations each 0.1 mm of one stroke along x."""
    count = len(along)
    one, whole = np.ones(count), np.zeros(count, dtype=np.int64)
    at = np.column_stack([along, 0 * along])
    return Stations(
        at_mm=at, z_mm=0 * one, normal=at, piece=whole, stroke=whole, along_mm=along,
        length_mm=0.1 * one, expected_mm=one, width_mm=one, u_width_mm=one, offset_mm=one,
        present=one, seen=seen, why=whole if why is None else why,
    )  # fmt: skip


@pytest.mark.parametrize("kind", ["camera", "folder", "command"])
@pytest.mark.parametrize("shape", [(20, 20, 3), (5, 6, 7)])
def test_a_device_that_gives_the_same_twice_hangs(kind: str, shape: tuple[int, ...]) -> None:
    first, second = np.random.default_rng(1).integers(0, 255, (2, *shape), dtype=np.uint8)
    order = SimpleNamespace(device=SimpleNamespace(kind=kind))
    job = ObservedJob(Path(), cast(Any, order))
    job._check_new(first, None)
    job._check_new(second, first)
    with pytest.raises(DeviceError, match="gave the last picture once more"):
        job._check_new(second.copy(), None)
    with pytest.raises(DeviceError, match="gave the last picture once more"):
        job._check_new(first, first.copy())


def test_the_slab_of_filaments_holds_where_they_begin() -> None:
    """A piece that led upwards was looked for above its own end alone: its ink was a gap."""
    rows, lines = np.arange(2), SimpleNamespace(fresh=np.ones(2, dtype=np.bool_))
    ink = SimpleNamespace(
        style="embedded",
        start=np.array([[0.0, 0, 2.0], [3.0, 0, 5.0]]),
        end=np.array([[3.0, 0, 5.0], [6.0, 0, 7.0]]),
        height_mm=np.array([0.4, 0.8]),
    )
    held = cast(Any, SimpleNamespace(ink=ink, layer=SimpleNamespace(row=rows, lines=lines)))
    middle, thick = slab(held)
    assert (middle - thick / 2, middle + thick / 2) == pytest.approx((1.8, 7.4))


def test_what_one_picture_does_not_tell_and_the_other_shows_as_a_gap_is_asked_about() -> None:
    def gap(begin: float, end: float) -> Gap:
        return Gap(0, begin, end, (begin, 0.0), (end, 0.0), 0.0, 1.0)

    along = np.arange(0.05, 7.0, 0.1)

    def picture(
        gaps: tuple[Gap, ...] = (), unseen: tuple[Gap, ...] = (), sees: bool = False
    ) -> SimpleNamespace:
        stations = stations_of(along, np.full(len(along), sees))
        return SimpleNamespace(bare=(), gaps=gaps, unseen=unseen, stations=stations)

    nothing, clear = picture(unseen=(gap(0, 7),)), picture(sees=True)
    faint, faint_gap = picture(), picture(gaps=(gap(4, 7),))
    clear_gap = picture(gaps=(gap(4, 7),), sees=True)
    doubted = picture(unseen=(gap(2, 6),), sees=True)
    path = SimpleNamespace(
        at=lambda along: np.column_stack([along, 0 * along, 0 * along]), length_mm=7.0,
        command=np.array([0]),
    )  # fmt: skip
    at = SimpleNamespace(
        ink=SimpleNamespace(paths=(path,)), marks=Marks([]), layer=SimpleNamespace(mended=())
    )
    for each, told in (
        ([nothing], [(0, 7)]),
        ([nothing, nothing], [(0, 7)]),
        ([nothing, faint], [(0, 7)]),
        ([nothing, faint_gap], [(0, 7)]),
        ([faint, nothing], [(0, 7)]),
        ([nothing, clear], []),
        ([nothing, clear_gap], [(4, 7)]),
        ([clear_gap, nothing], [(4, 7)]),
        ([clear_gap, clear_gap], []),
        ([clear, nothing], []),
        ([faint, faint_gap], [(4, 7)]),
        ([faint_gap, faint], [(4, 7)]),
        ([clear, faint_gap], []),
        ([doubted, doubted], [(2, 6)]),  # either was told by the other's ink
        ([doubted, clear], []),
    ):
        found = unseen_paths(cast(HeldLook, at), cast(list[LayerFindings], each), 1.5)
        assert [(one.gap.from_mm, one.gap.to_mm) for one in found] == told
    for scanned in (False, True):
        order = SimpleNamespace(oct=scanned, limits=SimpleNamespace(unseen_mm=1.5))
        bath = SimpleNamespace(
            ink=SimpleNamespace(paths=(path,), style="embedded"), marks=at.marks, layer=at.layer
        )
        seen = ObservedJob._unseen(
            cast(Any, SimpleNamespace(order=order)), cast(Any, bath), [nothing]
        )
        assert len(seen) == 1


@pytest.mark.parametrize(
    ("sees", "gaps", "told"),
    [
        (False, (), [(1.0, 1.8)]),
        (True, (), []),
        (True, ((2.0, 2.95),), [(3.0, 3.6)]),  # over older ink, and a gap runs into it
        (True, ((2.0, 2.7),), []),
    ],
)
def test_a_stretch_that_no_picture_sees_is_told_by_its_length(sees, gaps, told):
    gaps = tuple(Gap(0, *one, (0.0, 0.0), (0.0, 0.0), 0.0, 0.0) for one in gaps)
    along = np.arange(0.05, 4.0, 0.1)
    hidden = (along > 1.0) & (along < 1.8) | (along > 2.5) & (along < 2.6)
    older = (along > 3.0) & (along < 3.6)

    def picture(seen):
        why = np.where(older, int(Unseen.OLD_INK), np.where(seen, 0, int(Unseen.GLARE)))
        return SimpleNamespace(stations=stations_of(along, seen, why), gaps=gaps)

    path = SimpleNamespace(
        at=lambda along: np.column_stack([along, 0 * along, 0 * along]), length_mm=4.0,
        command=np.array([0]),
    )  # fmt: skip
    at = SimpleNamespace(
        ink=SimpleNamespace(paths=(path,)), marks=Marks([]), layer=SimpleNamespace(mended=())
    )
    each = [picture(~(hidden | older)), picture(np.full(len(along), sees) & ~older)]
    found = hidden_stretches(cast(HeldLook, at), cast(list[LayerFindings], each), 0.2)
    assert [(round(one.gap.from_mm, 6), round(one.gap.to_mm, 6)) for one in found] == told
