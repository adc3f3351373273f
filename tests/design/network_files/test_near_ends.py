"""Ends beside a node are joined to it, in every format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from design.network_files.by_suffix import read_with_notes, write_network
from tests.design.networks import polylines


def forked(gap_mm: float) -> list[np.ndarray]:
    """A vessel of 5 mm and two daughters, one of which begins beside the others' node."""
    return [
        np.array([[0, 0, 0], [5, 0, 0]], dtype=float),
        np.array([[5, 0, 0], [9, 2, 0]], dtype=float),
        np.array([[5, 0, gap_mm], [9, -2, 0]], dtype=float),
    ]


@pytest.mark.parametrize("suffix", [".csv", ".json", ".npz", ".swc"])
@pytest.mark.parametrize("gap_mm", [1e-6, 5e-4, 0.02, 0.1])
def test_an_end_beside_a_node_is_joined_to_it_and_said(tmp_path: Path, suffix: str, gap_mm: float):
    path = tmp_path / f"network{suffix}"
    write_network(path, polylines(forked(gap_mm), 0.3))
    read, notes = read_with_notes(path, "mm" if suffix == ".csv" else None)
    assert len(read.nodes) == 4
    assert (read.degree() == 3).sum() == 1
    assert any("joined" in note for note in notes)
    ends = read.points[read.offset[:-1]]
    np.testing.assert_allclose(ends, read.nodes[read.vessel_nodes[:, 0]], atol=1e-9)


@pytest.mark.parametrize("gap_mm", [0.2, 1.0])
def test_what_lies_farther_off_stays_a_vessel_of_its_own(tmp_path: Path, gap_mm: float) -> None:
    write_network(tmp_path / "network.json", polylines(forked(gap_mm), 0.3))
    read, notes = read_with_notes(tmp_path / "network.json")
    assert len(read.nodes) == 5
    assert not any("joined" in note for note in notes)
