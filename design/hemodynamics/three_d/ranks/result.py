"""Read the result files of the MPI flow solver from a case folder."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from design.errors import FlowError
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class RankResult:
    """Result of a 3D flow solution on MPI ranks.

    Attributes
    ----------
    velocity : (n + e, 3) float64, mm/s
        At the mesh's nodes.
    pressure : (n,) float64, Pa
        At its corners.
    port_flow : (k,) float64, µL/s
        Out of each port.
    port_pressure : (k,) float64, Pa
        Its mean over each port.
    report : dict
        `ranks.json`: ranks, unknowns, solver, steps with residuals and iterations, seconds,
        memory of each rank.
    """

    velocity: FloatArray
    pressure: FloatArray
    port_flow: FloatArray
    port_pressure: FloatArray
    report: dict[str, Any]


def read_result(folder: Path) -> RankResult:
    """Read what a run left in a case's folder.

    Raises
    ------
    FlowError
        Where there is no result, or one of another case.
    """
    try:
        case = json.loads((folder / "case.json").read_text(encoding="utf-8"))
        report = json.loads((folder / "ranks.json").read_text(encoding="utf-8"))
        velocity, pressure = (np.load(folder / f"{x}.npy") for x in ("velocity", "pressure"))
    except FileNotFoundError as exc:
        raise FlowError(f"{exc.filename} isn't there: the case hasn't been solved; run it") from exc
    if report["case"] != case["id"]:
        raise FlowError(f"{folder}: the result is of another case; run it again")
    return RankResult(
        velocity,
        pressure,
        np.array([port["flow_out_ul_s"] for port in report["ports"]]),
        np.array([port["pressure_pa"] for port in report["ports"]]),
        report,
    )
