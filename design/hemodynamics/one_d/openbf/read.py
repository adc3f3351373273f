"""Read openBF's YAML input as a network with conditions for the 1D solver.

Format: docs/src/man/config.md of github.com/INSIGNEO/openBF, and where that is silent src/ of the
version of 2026 (commit 0376f4d). Every key is either followed or refused by name and place. Input
is in SI units.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from design.errors import FlowError
from design.hemodynamics.json_keys import entries, text, whole
from design.hemodynamics.one_d.openbf.case import PLACES, QUANTITIES, OpenBFCase
from design.hemodynamics.one_d.openbf.keys import (
    BLOOD,
    SOLVER,
    SPACED,
    TOP,
    VESSEL,
    quantity,
    section,
)
from design.hemodynamics.one_d.openbf.vessels import Vessels, read_vessels
from design.hemodynamics.one_d.options import OneDOptions
from design.hemodynamics.probes import Probes
from design.hemodynamics.waveforms import Tabulated
from design.hemodynamics.zero_d.pulsatile.conditions import PulsatileConditions
from kernels.arrays import FloatArray

_MARKS: Final = {"network", "blood", "solver"}
_UL: Final = 1e9
_LEAST_CYCLES: Final = 60
"""Cycles in which ours looks for the periodic state at least; openBF stops where it is told."""


def is_openbf(data: Any) -> bool:
    """Whether parsed YAML is an input file of openBF."""
    return isinstance(data, Mapping) and data.keys() >= _MARKS


def inlet_file(data: Mapping[str, Any]) -> str:
    """Name of the inlet's table: ``inlet_file``, or that of the project.

    Raises
    ------
    FlowError
        When it isn't text.
    """
    given = section(data, "the file", TOP)
    if "inlet_file" in given:
        return text(given, "inlet_file", "the file")
    return text(given, "project_name", "the file") + "_inlet.dat"


def case_of(data: Any, inlet: FloatArray) -> OpenBFCase:
    """Return the case that parsed YAML describes.

    Parameters
    ----------
    data : Any
    inlet : (n, 2) float64
        Time, s, and flow, m³/s, of one cycle.

    Raises
    ------
    FlowError
        For a key that isn't modelled, and for what is missing or wrong.
    """
    given = section(data, "the file", TOP)
    blood = section(given.get("blood"), "blood", BLOOD)
    solver = section(given.get("solver"), "solver", SOLVER)
    density = quantity(blood, "rho", "blood", (1.0, 1e5)) * 1e-6
    listed = [section(v, f"network[{k}]", VESSEL) for k, v in enumerate(entries(given, "network"))]
    if not listed:
        raise FlowError("network: no vessel is given")
    vessels = read_vessels(listed, density)
    folder = text(given, "output_directory", "the file") if "output_directory" in given else None
    return OpenBFCase(
        project=text(given, "project_name", "the file"),
        labels=vessels.labels,
        network=vessels.network,
        conditions=PulsatileConditions(
            viscosity_pa_s=quantity(blood, "mu", "blood", (1e-9, 1e3)),
            inlet=_inlet_wave(inlet),
            outlet=vessels.outlets,
            wall=vessels.walls,
            density=density,
        ),
        options=_options(solver, vessels),
        quantities=_quantities(given),
        shown=vessels.shown,
        folder=folder,
        tolerance_mmhg=quantity(solver, "convergence_tolerance", "solver", (1e-12, 1e6)),
        notes=_notes(given),
    )


def _notes(given: Mapping[str, Any]) -> tuple[str, ...]:
    spaced = [one for one in entries(given, "network") if SPACED in one]
    if not spaced:
        return ()
    return (
        f"{SPACED!r} is taken as gamma_profile, the exponent of the velocity profile, in "
        f"{len(spaced)} vessels; openBF of 2026 passes over the key with a space and computes "
        "with 2",
    )


def _inlet_wave(inlet: FloatArray) -> Tabulated:
    table = np.asarray(inlet, dtype=np.float64)
    if table.ndim != 2 or table.shape[1] != 2 or len(table) < 2:
        raise FlowError(
            "inlet_file: write two columns, time in s and flow in m³/s, two rows or more"
        )
    if table[0, 0] != 0.0:
        raise FlowError(f"inlet_file: its time begins at {table[0, 0]:g} s; begin at 0")
    try:
        return Tabulated(table[:, 0], table[:, 1] * _UL)
    except FlowError as exc:
        raise FlowError(f"inlet_file: {exc}") from exc


def _options(solver: Mapping[str, Any], vessels: Vessels) -> OneDOptions:
    count = len(vessels.labels)
    probes = Probes(np.repeat(np.arange(count), len(PLACES)), np.tile(PLACES, count))
    return OneDOptions(
        cell_mm=vessels.network.lengths() / vessels.cells,
        profile_exponent=vessels.exponents,
        alpha=1.0,
        reflection=vessels.reflection,
        courant=quantity(solver, "Ccfl", "solver", (0.01, 1.0)),
        samples=whole(solver, "jump", "solver", 8),
        most_cycles=max(_LEAST_CYCLES, whole(solver, "cycles", "solver", 1)),
        probes=probes,
    )


def _quantities(given: Mapping[str, Any]) -> tuple[str, ...]:
    asked = entries(given, "write_results") if "write_results" in given else list(QUANTITIES)
    if not asked:
        raise FlowError(f"write_results is empty; write {', '.join(QUANTITIES)}, or leave it out")
    for name in asked:
        if name not in QUANTITIES:
            raise FlowError(
                f"write_results: {name!r} isn't written by openBF; write {', '.join(QUANTITIES)}"
            )
    return tuple(name for name in QUANTITIES if name in asked)
