"""Inputs of svZeroDSolver, written by hand for the tests."""

from __future__ import annotations

from typing import Any

import numpy as np


def case(
    conditions: dict[str, tuple[str, dict[str, Any]]],
    vessels: dict[str, tuple[dict[str, float], str | None, str | None]],
    junctions: list[dict[str, Any]] | None = None,
    points: int = 101,
    cycles: int = 1,
    kind: str = "BloodVessel",
    **parameters: Any,
) -> dict[str, Any]:
    """Vessels by name: values, condition at the inlet, condition at the outlet."""
    found = []
    for k, (name, (values, inlet, outlet)) in enumerate(vessels.items()):
        ends = {side: c for side, c in (("inlet", inlet), ("outlet", outlet)) if c}
        found.append(
            {
                "vessel_id": k,
                "vessel_name": name,
                "boundary_conditions": ends,
                "zero_d_element_type": kind,
                "zero_d_element_values": values,
            }
        )
    return {
        "simulation_parameters": {
            "number_of_cardiac_cycles": cycles,
            "number_of_time_pts_per_cardiac_cycle": points,
            **parameters,
        },
        "boundary_conditions": [
            {"bc_name": name, "bc_type": of_kind, "bc_values": values}
            for name, (of_kind, values) in conditions.items()
        ],
        "vessels": found,
        "junctions": junctions or [],
    }


def wave(key: str, mean: float, swing: float, samples: int = 401) -> dict[str, Any]:
    """A sine of period 1, by samples."""
    time = np.linspace(0.0, 1.0, samples)
    value = mean + swing * np.sin(2.0 * np.pi * time)
    value[-1] = value[0]
    return {key: value.tolist(), "t": time.tolist()}


def steady(key: str, value: float) -> dict[str, Any]:
    """A constant."""
    return {key: [value, value], "t": [0.0, 1.0]}


def fork(kind: str, values: dict[str, list[float]]) -> dict[str, Any]:
    """Flow 5 into a vessel of 10, divided between two of 20; behind them 3 to 7 and 4 to 2."""
    return case(
        {
            "IN": ("FLOW", steady("Q", 5.0)),
            "A": ("RESISTANCE", {"R": 3.0, "Pd": 7.0}),
            "B": ("RESISTANCE", {"R": 4.0, "Pd": 2.0}),
        },
        {
            "trunk": ({"R_poiseuille": 10.0}, "IN", None),
            "left": ({"R_poiseuille": 20.0}, None, "A"),
            "right": ({"R_poiseuille": 20.0}, None, "B"),
        },
        [
            {
                "junction_name": "J",
                "junction_type": kind,
                "junction_values": values,
                "inlet_vessels": [0],
                "outlet_vessels": [1, 2],
            }
        ],
        points=11,
    )
