"""Printability limits of needle, bath and method."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from design.toolpath.embedded import EmbeddedOptions
from firmware_profiles import Bath, Ink, Needle, load
from printctl.pipeline.heads import needle_options
from printctl.pipeline.printability import printability
from printctl.recipe.making import Embedded, Fresh


def context(part: Embedded | Fresh, print_scale: float = 1.0, **bath: float) -> Any:
    """As much of a run's context as is asked."""
    ink = load(Ink, "gelatin_sacrificial")
    return SimpleNamespace(
        recipe=SimpleNamespace(toolpath=part, print_scale=print_scale),
        needle=load(Needle, part.needle),
        ink=ink,
        bath=load(Bath, "cell_matrix").model_copy(update=bath),
    )


def test_a_firm_bath_leaves_the_limit_to_the_plunger() -> None:
    limits = printability(context(Embedded(method="embedded")))
    assert limits.widest_mm == pytest.approx(3.568, rel=1e-3)  # 2 µL/s at 0.2 mm/s
    assert "plunger" in limits.says


def test_a_weak_bath_limits_the_widest_vessel() -> None:
    weak = context(Embedded(method="embedded"), yield_stress_pa=0.02, density_g_cm3=1.05)
    limits = printability(weak)
    # 0.02 Pa / (0.07 × 20 kg/m³ × 9.81 m/s²)
    assert limits.widest_mm == pytest.approx(1.456, rel=1e-3)
    assert "1.46 mm, which the bath's yield stress holds" in limits.says


def test_limits_are_said_in_the_design_s_size() -> None:
    part = Embedded(method="embedded")
    small, large = printability(context(part), 0.3), printability(context(part, 4.0), 0.3 / 4)
    assert large.lumen_mm == pytest.approx(small.lumen_mm / 4)
    assert large.widest_mm == pytest.approx((small.widest_mm or 0) / 4)
    assert large.wall_mm == pytest.approx(small.wall_mm / 4)
    assert "printed 4 times the design's size" in large.says


def test_layers_have_no_widest_lumen() -> None:
    assert printability(context(Fresh(method="fresh"))).widest_mm is None


def test_a_tapered_tip_is_planned_as_one() -> None:
    plain = load(Needle, "30g")
    tapered = Needle.model_validate(plain.model_dump() | {"tip_outer_mm": 0.25, "cone_mm": 4.0})
    assert EmbeddedOptions(**needle_options(plain)).tip_mm == pytest.approx(0.31 / 2 + 0.05)
    options = EmbeddedOptions(**needle_options(tapered))
    assert (options.tip_mm, options.cone_mm) == pytest.approx((0.25 / 2 + 0.05, 4.0))
    assert options.shaft_mm == pytest.approx(0.31 / 2 + 0.05)
