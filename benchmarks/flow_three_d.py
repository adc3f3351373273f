"""3D flow: ``python -m benchmarks.flow_three_d``.

Each case runs in a fresh process, so that its peak of memory is its own and the engine is loaded
once; its time is that of `solve_steady`, the median of three. Pressures, shear and flow are held
against closed forms, or against the same case at another order.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from benchmarks.command import Job, Row, run
from benchmarks.machine import ROOT, peak_mb, row
from design.hemodynamics import FlowConditions, PulsatileConditions
from design.hemodynamics.three_d import FlowOptions, Stepping, march_flow, solve_steady
from design.hemodynamics.three_d.engine import load_engine
from design.hemodynamics.vessel_coefficients import impedance_factor, womersley_number
from design.hemodynamics.waveforms import Sine
from tests.design.hemodynamics.three_d.lumens import pipe

VISCOSITY, FLOW, RADIUS, LENGTH = 1e-3, 4.0, 0.5, 5.0
REPEATS = 3

Found = dict[str, float]


def pipe_case(order: int, rings: int, layers: int) -> Found:
    """Navier–Stokes flow in a pipe, against Poiseuille's law."""
    mesh = pipe(rings, layers, RADIUS, LENGTH)
    load_engine()
    seconds, cpu = [], []
    for _ in range(REPEATS):
        begun, spent = time.perf_counter(), time.process_time()
        found = solve_steady(
            mesh, FlowConditions(VISCOSITY, inlet_flow_ul_s=FLOW), FlowOptions(order)
        )
        seconds.append(time.perf_counter() - begun)
        cpu.append(time.process_time() - spent)
    drop = 8.0 * VISCOSITY * LENGTH * FLOW / (np.pi * RADIUS**4)
    shear = found.wall_shear.magnitude / (4.0 * VISCOSITY * FLOW / (np.pi * RADIUS**3)) - 1.0
    return {
        "unknowns": found.unknowns,
        "pressure": abs(float(found.port_pressure[0] - found.port_pressure[1]) / drop - 1.0),
        "shear": float(np.abs(shear).max()),
        "shear_rms": float(np.sqrt((shear**2).mean())),
        "mass": found.mass_imbalance,
        "energy": found.energy.imbalance,
        "seconds": statistics.median(seconds),
        "cpu": statistics.median(cpu),
    }


def womersley_case(steps: int, period: float) -> Found:
    """Pulsatile Navier–Stokes flow in a pipe: pressure drop at the pulse's frequency."""
    begun = time.perf_counter()
    waves = march_flow(
        pipe(2, 6, RADIUS, LENGTH),
        PulsatileConditions(VISCOSITY, Sine(FLOW, 2.0, period), profile="womersley"),
        stepping=Stepping(steps, frames=0),
    )
    alpha = womersley_number(np.array([RADIUS]), 2.0 * np.pi / period, VISCOSITY)
    exact = 8.0 * VISCOSITY * LENGTH / (np.pi * RADIUS**4) * impedance_factor(alpha)[0] * -2.0j
    drop = 2.0 * np.fft.rfft(waves.port_pressure[0] - waves.port_pressure[1])[1] / steps
    return {
        "error": float(abs(drop / exact - 1.0)),
        "alpha": float(alpha[0]),
        "cycles": len(waves.change),
        "seconds": time.perf_counter() - begun,
    }


CASES: dict[str, Callable[..., Found]] = {"pipe": pipe_case, "womersley": womersley_case}


def fresh(case: str, **given: Any) -> Found:
    """A case's numbers and its peak of memory, MB, from a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.flow_three_d", "--case", case, json.dumps(given)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    found: Found = json.loads(done.stdout.splitlines()[-1])
    return found


def pipe_rows(quick: bool) -> Iterator[Row]:
    """The promise, and the other order beside it."""
    found = fresh("pipe", order=3, rings=2, layers=8)
    name = f"pipe, curved P3/P2, {found['unknowns']:,} unknowns"
    yield row(f"{name}: pressure drop", found["pressure"], "", "<= 1e-3", found["pressure"] <= 1e-3)
    yield row(f"{name}: wall shear, worst node", found["shear"], "", "<= 3e-3",
              found["shear"] <= 3e-3)  # fmt: skip
    yield row(f"{name}: unknowns", found["unknowns"], "", "<= 35000", found["unknowns"] <= 35000)
    yield row(f"{name}: time", found["seconds"], "s", "<= 2", found["seconds"] <= 2.0)
    yield row(f"{name}: time", found["cpu"], "CPU s")
    yield row(f"{name}: peak memory", found["peak_mb"], "MB")
    yield row(f"{name}: energy", found["energy"], "")
    if quick:
        return
    for order, rings, layers in ((2, 2, 10), (2, 4, 20), (3, 1, 6), (3, 3, 12)):
        other = fresh("pipe", order=order, rings=rings, layers=layers)
        name = f"pipe, P{order}/P{order - 1}, {other['unknowns']:,} unknowns"
        yield row(f"{name}: pressure drop", other["pressure"], "")
        yield row(f"{name}: wall shear, worst node", other["shear"], "")
        yield row(f"{name}: time", other["cpu"], "CPU s")


def womersley_rows(quick: bool) -> Iterator[Row]:
    """Error of time steps."""
    for steps in (40,) if quick else (20, 40, 80):
        found = fresh("womersley", steps=steps, period=0.1)
        name = f"pulsatile pipe, Womersley number {found['alpha']:.1f}, {steps} steps"
        yield row(f"{name}: pressure drop's phasor", found["error"], "")
        yield row(f"{name}: time to a periodic state", found["seconds"], "s")


JOBS: dict[str, Job] = {"pipe": pipe_rows, "womersley": womersley_rows}


if __name__ == "__main__":
    if sys.argv[1:2] == ["--case"]:
        result = CASES[sys.argv[2]](**json.loads(sys.argv[3]))
        print(json.dumps(result | {"peak_mb": peak_mb()}))
    else:
        run(JOBS, __doc__)
