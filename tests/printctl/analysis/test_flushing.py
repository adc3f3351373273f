"""Pressure limit of flushing, against Poiseuille's law."""

from __future__ import annotations

import math

import pytest

from printctl.analysis.flushing import flush_limit


def test_the_flush_limit_scales_poiseuille_flow_to_the_wall_shear_allowed(tmp_path):
    # One tube: wall shear 4 µ Q / (π r³), pressure drop 8 µ L Q / (π r⁴); their ratio is 2 L / r.
    r, length, mu, q = 0.25e-3, 10e-3, 1e-3, 1e-9
    shear = 4 * mu * q / (math.pi * r**3)
    drop = 8 * mu * length * q / (math.pi * r**4)
    table = tmp_path / "flow.csv"
    table.write_text(f"vessel,pressure_in_pa,pressure_out_pa,wall_shear_pa\n3,{drop},0,{shear}\n")
    found = flush_limit(table, 2.0)
    assert found is not None
    assert found.vessel == "3"
    assert found.pressure_pa == pytest.approx(2.0 * 2 * length / r)
    assert flush_limit(tmp_path / "none.csv", 2.0) is None
