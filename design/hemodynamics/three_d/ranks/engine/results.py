"""Gather velocity, pressure and port flows from the MPI ranks and write them to files."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

from .problem import Field, RanksProblem, flows
from .world import WORLD


def port_rows(problem: RanksProblem) -> list[dict[str, Any]]:
    """Flow out of each port and mean pressure over it."""
    pressure = ufl.split(problem.solution)[1]
    one = fem.Constant(problem.space.mesh, PETSc.ScalarType(1.0))
    rows = []
    for port, flow in zip(problem.case["ports"], flows(problem, problem.loads), strict=True):
        over = problem.faces(port["label"])
        push, area = (
            WORLD.allreduce(float(fem.assemble_scalar(fem.form(value * over))))
            for value in (pressure, one)
        )
        rows.append(
            {
                "label": port["label"],
                "flow_out_ul_s": float(flow),
                "pressure_pa": push / area,
                "area_mm2": area,
            }
        )
    return rows


def write_field(path: Path, problem: RanksProblem, field: Field, shape: tuple[int, ...]) -> None:
    """Write a field at the file's nodes, from the first rank."""
    values = problem.solution.x.array[field.unknown].reshape(-1, *shape[1:])
    parts = WORLD.gather((field.node, values))
    if parts is None:
        return
    whole = np.full(shape, np.nan)
    for node, each in parts:
        whole[node] = each
    draft = path.with_name(f".{os.getpid()}.{path.name}")
    np.save(draft, whole)
    draft.replace(path)


def write_report(path: Path, report: dict[str, Any]) -> None:
    """Write the report, from the first rank."""
    if WORLD.rank == 0:
        draft = path.with_name(f".{os.getpid()}.{path.name}")
        draft.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
        draft.replace(path)
