"""Ink of several heads, read at each tip's own position."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_profiles import Printer, load
from firmware_profiles.bead import BeadSection
from printctl.checks.lumens import Writing, read_filaments, read_layers
from printctl.errors import UsageError

PRINTER = load(Printer, "two_syringe_marlin")
# Both tips' lines meet at x = 60: the second stands 40 mm beside the first.
JOB = b"""M218 T1 X0 Y0 Z0
M280 P1 S90
T0 S1
M280 P0 S10
G92 E0
G1 X50 Y50 Z10 F300
G1 X60 E1 F600
M280 P0 S90
T1 S1
G92 E0
M280 P1 S10
G1 X20 Y50 F3000
G1 X30 E2 F600
G1 Z10.1 F300
G1 X20 E4 F600
"""
START = (50.0, 50.0, 10.0)
AREAS = (0.15, 0.30)


def writing(**said: object) -> Writing:
    return Writing(PRINTER, start_mm=START, **said)  # type: ignore[arg-type]


def layers(**said: object) -> Writing:
    return writing(layer_mm=0.1, beads=(BeadSection("rectangle"),), **said)


def test_layers_of_two_heads_lie_where_their_tips_were() -> None:
    for lines in read_layers(JOB, layers(ul_per_e_of_heads=AREAS)):
        np.testing.assert_allclose(lines.start[:, 0], [50, 60, 70], atol=1e-9)
        np.testing.assert_allclose(lines.end[:, 0], [60, 70, 60], atol=1e-9)
        assert lines.layer.tolist() == [0, 0, 1]
        # Cross-section over the layer: each head by its own syringe.
        np.testing.assert_allclose(lines.width, [0.15, 0.6, 0.6], rtol=1e-6)


def test_filaments_of_two_heads_are_strokes_of_their_own() -> None:
    ideal, stepped = read_filaments(JOB, writing(ul_per_e_of_heads=AREAS))
    assert ideal.passes == 3
    np.testing.assert_allclose(ideal.start[:, 0], [50, 60, 70], atol=1e-9)
    np.testing.assert_allclose(np.pi * ideal.radius**2, [0.015, 0.06, 0.06], rtol=1e-6)
    assert stepped.start[:, 0].min() == pytest.approx(50)
    assert stepped.end[:, 0].max() == pytest.approx(70)
    assert (np.diff(stepped.stroke) >= 0).all()


def test_a_job_that_writes_nothing_and_an_unknown_syringe_are_refused() -> None:
    with pytest.raises(UsageError, match="what one E means"):
        read_layers(JOB, writing())
    idle = JOB.replace(b" E1", b"").replace(b" E2", b"").replace(b" E4", b"")
    for read in (read_layers, read_filaments):
        with pytest.raises(UsageError, match="is E in it"):
            read(idle, writing(ul_per_e=0.15))
