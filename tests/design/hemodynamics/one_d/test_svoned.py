"""svOneDSolver's input: every card well formed, every name known, units converted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import (
    GelWall,
    OneDOptions,
    PulsatileConditions,
    ResistanceOutlet,
    RigidWall,
    WindkesselOutlet,
    write_svoned,
)
from design.hemodynamics.one_d import svoned_input
from design.hemodynamics.waveforms import Sine
from tests.design.hemodynamics.networks import network_of

FORK = network_of(
    # Inlet 1 and junction 3: numbers that the writer has to change.
    [[15, 5, 0], [0, 0, 0], [15, -5, 0], [10, 0, 0]],
    [(1, 3), (3, 0), (3, 2)],
    [0.5, 0.4, 0.3],
)
CONDITIONS = PulsatileConditions(
    1e-3,
    Sine(4.0, 2.0, 0.8),
    wall=GelWall(1e4),
    outlet={0: WindkesselOutlet(2.0, 0.01, 8.0, 100.0), 2: ResistanceOutlet(5.0)},
)
FIELDS = {"MODEL": 1, "NODE": 4, "JOINT": 4, "SEGMENT": 16, "MATERIAL": 9, "SOLVEROPTIONS": 9}


def cards(text: str) -> tuple[list[list[str]], dict[str, list[list[float]]]]:
    """Cards, and data tables by name; read as the solver does, word by word."""
    found, tables, open_ = [], {}, None
    for line in text.splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "DATATABLE":
            assert words[2] == "LIST"
            open_ = tables.setdefault(words[1], [])
        elif words[0] == "ENDDATATABLE":
            open_ = None
        elif open_ is not None:
            open_.append([float(word) for word in words])
        else:
            found.append(words)
    return found, tables


def test_every_card_is_whole_and_refers_to_what_is_there(tmp_path: Path) -> None:
    path = tmp_path / "fork.in"
    write_svoned(path, FORK, CONDITIONS)
    found, tables = cards(path.read_text())
    for card in found:
        if card[0] in FIELDS:
            assert len(card) - 1 == FIELDS[card[0]], card
    by = {kind: [c[1:] for c in found if c[0] == kind] for kind in {c[0] for c in found}}
    at = {n[0]: 10.0 * np.array([float(x) for x in n[1:]]) for n in by["NODE"]}
    # The only joint has to be at the first node listed.
    assert by["JOINT"][0][1] == by["NODE"][0][0] == "0"
    np.testing.assert_allclose(at["0"], FORK.nodes[3])
    assert by["JOINTINLET"][0][1:] == ["1", "0"]
    assert by["JOINTOUTLET"][0][1:] == ["2", "1", "2"]
    materials = {m[0]: m for m in by["MATERIAL"]}
    for k, segment in enumerate(by["SEGMENT"]):
        first, last = FORK.vessel_nodes[k]
        np.testing.assert_allclose(at[segment[4]], FORK.nodes[first])
        np.testing.assert_allclose(at[segment[5]], FORK.nodes[last])
        assert float(segment[6]) == pytest.approx(np.pi * FORK.mean_radius()[k] ** 2 / 100.0)
        assert segment[14] == ("NOBOUND", "RCR", "RESISTANCE")[k]
        assert segment[15] == "NONE" or segment[15] in tables
        # dA/dp at rest, 2 A₀/(4/3 k₃), is the gel's 2 A₀ (1 + ν)/E; in dyn/cm².
        assert 4 / 3 * float(materials[segment[9]][8]) == pytest.approx(1e4 / 1.5 * 10.0)
    assert float(by["MATERIAL"][0][2]) == pytest.approx(1.06)
    assert float(by["MATERIAL"][0][3]) == pytest.approx(0.01)
    assert [row[1] for row in tables["END0"]] == pytest.approx([2e4, 1e-6, 8e4, 1e3])
    assert [row[1] for row in tables["END2"]] == pytest.approx([5e4, 0.0])
    time, flow = np.array(tables["INLET"]).T
    assert time[-1] == pytest.approx(0.8)
    assert flow[-1] == flow[0]
    assert flow.mean() == pytest.approx(4e-3, rel=0.01)


@pytest.mark.parametrize(
    ("change", "options", "words"),
    [
        ({"wall": RigidWall()}, {}, "rigid wall"),
        ({}, {"wall_viscosity_pa_s": 5.0}, "no viscous wall"),
        ({"inlets": (1, 0), "outlets": (2,)}, {}, "takes one"),
    ],
)
def test_what_it_cannot_say_is_refused(change, options, words) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(FlowError, match=words):
        svoned_input(FORK, replace(CONDITIONS, **change), OneDOptions(**options))
