"""Pipeline stage of the simulated scanner: its input."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from printctl.pipeline.stages import scan
from printctl.recipe.making import Embedded, Fresh, SimulatedScan
from sim.faults.ink_faults import Clog


class LaidError(Exception):
    """The deposit was asked for; its area in mm² and the faults are the arguments."""


@pytest.mark.parametrize("factor", [1.0, 0.8])
def test_what_comes_out_is_laid_and_not_what_is_pushed(
    factor: float, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def deposit(motion: Any, area: float, *rest: Any, **more: Any) -> None:
        raise LaidError(area, more["faults"])

    monkeypatch.setattr(scan, "deposit", deposit)
    (tmp_path / "faults.yaml").write_text("ink: [{fault: clog, line: 30}]\n")
    monkeypatch.setattr(scan.ExecutedMotion, "load", lambda path: None)
    context: Any = SimpleNamespace(
        folder=tmp_path,
        recipe_folder=tmp_path,
        poured=SimpleNamespace(
            syringe=SimpleNamespace(area_mm2=math.pi), ink=SimpleNamespace(flow_factor=factor)
        ),
        recipe=SimpleNamespace(toolpath=None, printer=SimpleNamespace(faults="faults.yaml")),
        flow_ul_s=None,
        printer=SimpleNamespace(steps_per_mm=SimpleNamespace(e=6400.0), heads=()),
    )
    with pytest.raises(LaidError) as laid:
        scan.simulate(context, SimulatedScan(simulated="oct"), lambda *told: None)
    assert laid.value.args[0] == pytest.approx(math.pi * factor)
    assert laid.value.args[1].each == (Clog(fault="clog", line=30),)


@pytest.mark.parametrize(
    ("part", "ink"), [(Fresh(method="fresh"), "gel"), (Embedded(method="embedded"), "lumen")]
)
def test_ink_is_the_part_s_gel_in_layers_and_melted_out_of_a_matrix(
    part: Fresh | Embedded, ink: str
) -> None:
    context: Any = SimpleNamespace(recipe=SimpleNamespace(toolpath=part))
    assert scan.ink_in_scan(context) == ink
