"""Embedded writing with two heads: arteries by one, veins by the other, few changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.errors import ToolpathError
from design.network import VesselKind, VesselNetwork
from design.toolpath.embedded import EmbeddedHeads, EmbeddedOptions, plan_embedded
from design.toolpath.toolpath import MoveKind

ARTERY, VEIN = VesselKind.ARTERY, VesselKind.VEIN
NODES = np.array([[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0], [0, 6, 0], [4, 6, 0.0]])
ENDS = np.array([[0, 1], [1, 2], [3, 2], [3, 4], [4, 5]])
KIND = np.array([ARTERY, ARTERY, VEIN, ARTERY, VEIN], dtype=np.int64)
NETWORK = VesselNetwork.from_segments(NODES, ENDS, np.full(5, 0.2), KIND, np.zeros(5, np.int64))
FINE = EmbeddedOptions(retract_ul=0.02, plunger_ul_s=0.4)
COARSE = replace(
    FINE, needle_inner_mm=0.21, needle_outer_mm=0.41, retract_ul=0.05, write_speed_mm_s=3.0
)
HEAD = (KIND == VEIN).astype(np.int64)
HEADS = EmbeddedHeads((FINE, COARSE), HEAD)


def test_each_vessel_is_written_by_its_own_head_at_its_own_speed():
    path = plan_embedded(NETWORK, HEADS).toolpath
    writes = path.kind == MoveKind.WRITE
    np.testing.assert_array_equal(path.tool[writes], HEAD[path.source[writes]])
    assert set(path.speed_mm_s[writes & (path.tool == 1)].tolist()) == {3.0}
    assert set(path.speed_mm_s[writes & (path.tool == 0)].tolist()) == {5.0}


def test_heads_are_changed_as_seldom_as_may_be():
    path = plan_embedded(NETWORK, HEADS).toolpath
    writes = path.tool[path.kind == MoveKind.WRITE]
    assert int((np.diff(writes) != 0).sum()) == 1


def test_each_head_s_relief_is_its_own_and_is_primed_again():
    path = plan_embedded(NETWORK, HEADS).toolpath
    for head, options in enumerate((FINE, COARSE)):
        own = path.tool == head
        reliefs = path.volume_ul[own & (path.kind == MoveKind.RETRACT)]
        primes = path.volume_ul[own & (path.kind == MoveKind.PRIME)]
        assert set(np.round(reliefs, 9).tolist()) <= {-options.retract_ul}
        assert set(np.round(primes, 9).tolist()) <= {options.retract_ul}
        assert len(reliefs) - len(primes) in (0, 1)


def test_a_change_of_head_is_relieved_and_lifted():
    path = plan_embedded(NETWORK, HEADS).toolpath
    for row in np.flatnonzero(np.diff(path.tool) != 0).tolist():
        before = path.kind[: row + 1]
        last_write = np.flatnonzero(before == MoveKind.WRITE)[-1]
        assert path.kind[last_write + 1] == MoveKind.RETRACT
        assert path.end[row, 2] > path.end[: row + 1][before == MoveKind.WRITE, 2].max()


def test_one_head_plans_as_without():
    one = plan_embedded(NETWORK, EmbeddedHeads.one(FINE, NETWORK)).toolpath
    plain = plan_embedded(NETWORK, FINE).toolpath
    for name in ("start", "end", "volume_ul", "speed_mm_s", "tool", "kind", "source"):
        np.testing.assert_array_equal(getattr(one, name), getattr(plain, name))


def test_a_vessel_too_thin_for_its_own_needle_is_refused():
    wide = replace(COARSE, needle_inner_mm=0.6, needle_outer_mm=0.8)
    with pytest.raises(ToolpathError, match="vessel 2"):
        plan_embedded(NETWORK, EmbeddedHeads((FINE, wide), HEAD))
    plan_embedded(NETWORK, EmbeddedHeads((FINE, wide), np.zeros(5, dtype=np.int64)))


def test_a_head_that_isn_t_there_is_refused():
    with pytest.raises(ToolpathError, match="vessel 2 is given to head 1"):
        EmbeddedHeads((FINE,), HEAD)
