"""STEP: pieces of a network, and the file as Open CASCADE reads it back."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from design.errors import SolidError
from design.solids import lumen_solid, write_step
from design.solids.step import MOST_PIECES, step_pieces
from tests.design.solids.networks import channels, ladder, lattice, vessel

FORK = channels([[0, 0, 0], [5, 0, 0], [9, 3, 0], [9, -3, 1]], [(0, 1), (1, 2), (1, 3)], 0.4)


def _occ() -> None:
    pytest.importorskip("netgen.occ", reason='the extra "step" isn\'t installed')


def test_pieces_are_frusta_and_balls_each_touching_one_before_it() -> None:
    pieces = step_pieces(FORK)
    assert sum(piece.is_ball for piece in pieces) == 4
    seen = {pieces[0].start.tobytes(), pieces[0].end.tobytes()}
    for piece in pieces[1:]:
        assert {piece.start.tobytes(), piece.end.tobytes()} & seen
        seen |= {piece.start.tobytes(), piece.end.tobytes()}


def test_what_is_too_large_is_refused_with_numbers(tmp_path, monkeypatch):
    monkeypatch.setattr("design.solids.step.load_occ", lambda: None)
    with pytest.raises(SolidError, match=f"more than the {MOST_PIECES}"):
        write_step(tmp_path / "a.step", lattice(6, 2.0, 0.3))


def test_a_missing_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "netgen", None)
    with pytest.raises(SolidError, match=r"pip install 'printctl\[step\]'"):
        write_step(tmp_path / "a.step", FORK)


def test_a_cone_with_round_ends_has_its_exact_volume(tmp_path: Path) -> None:
    _occ()
    check = write_step(tmp_path / "cone.step", vessel([[0, 0, 0], [0, 6, 8]], [0.5, 0.9]))
    frustum = np.pi / 3 * 10 * (0.25 + 0.45 + 0.81)
    caps = 2 / 3 * np.pi * (0.5**3 + 0.9**3)
    assert check.volume == pytest.approx(frustum + caps, rel=3e-3)
    assert (check.solids, check.file) == (1, "cone.step")
    assert (tmp_path / "cone.step").read_text().startswith("ISO-10303-21;")


def test_forks_loops_and_curves_have_the_triangles_volume(tmp_path: Path) -> None:
    _occ()
    turn = np.linspace(0, 1.5, 12)
    bend = vessel(np.stack([3 * np.cos(turn), 3 * np.sin(turn), 0 * turn], 1), 0.4)
    for network in (FORK, ladder(), bend):
        check = write_step(tmp_path / "n.step", network)
        assert check.solids == 1
        assert check.volume == pytest.approx(lumen_solid(network).volume_mm3, rel=2e-3)


def test_a_union_that_lost_a_part_is_refused(tmp_path, monkeypatch):
    _occ()
    monkeypatch.setattr("design.solids.step.step_pieces", lambda network: step_pieces(network)[:-2])
    with pytest.raises(SolidError, match="it lost a part"):
        write_step(tmp_path / "a.step", FORK)
    assert not (tmp_path / "a.step").exists()
