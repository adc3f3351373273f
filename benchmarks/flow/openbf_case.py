"""Read openBF's YAML input as a case of the 1D solver, and run it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np

from benchmarks.flow.case_keys import (
    check_keys,
    entries,
    flag,
    number,
    text,
    whole,
)
from design.errors import FlowError
from design.hemodynamics.conditions import (
    Outlet,
    PressureOutlet,
    PulsatileConditions,
    WindkesselOutlet,
)
from design.hemodynamics.one_d.grid import OneDOptions
from design.hemodynamics.one_d.solution import OneDSolution
from design.hemodynamics.one_d.solve import Progress, solve_one_d
from design.hemodynamics.probes import Probes
from design.hemodynamics.vessel_coefficients import VesselWalls
from design.hemodynamics.waveforms import Constant, Tabulated
from design.network import VesselKind, VesselNetwork
from design.units import PA_PER_MMHG
from kernels.arrays import FloatArray, IntArray

# Read openBF's YAML input as a network with conditions for the 1D solver.
#
# Format: docs/src/man/config.md of github.com/INSIGNEO/openBF, and where that is silent src/ of the
# version of 2026 (commit 0376f4d). Every key is either followed or refused by name and place. Input
# is in SI units.

_MARKS: Final = {"network", "blood", "solver"}


class SiUnits(NamedTuple):
    """What takes SI units to ours."""

    ul_per_m3: float = 1e9
    mm_per_m: float = 1e3
    pa_s_ul_per_pa_s_m3: float = 1e-9
    """Of resistances; a compliance takes its inverse."""


SI: Final = SiUnits()
_MIN_CYCLES: Final = 60
"""Cycles in which ours looks for the periodic state at least; openBF stops after its `cycles`."""
QUANTITIES: Final = ("P", "Q", "A", "u")
"""Pressure, flow, cross-section and mean velocity, as ``write_results`` names them."""
PLACES: Final = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Of a vessel's length, where openBF keeps waves (there: the middles of these cells)."""
TOP: Final = frozenset((
    "project_name", "write_results", "output_directory", "inlet_file", "blood", "solver",
    "network",
))  # fmt: skip
BLOOD: Final = frozenset(("mu", "rho"))
SOLVER: Final = frozenset(("Ccfl", "cycles", "convergence_tolerance", "jump"))
OUTLET: Final = frozenset(("outlet", "Rt", "R1", "R2", "Cc", "Pout", "inlet_impedance_matching"))
VESSEL: Final = OUTLET | frozenset((
    "label", "sn", "tn", "L", "E", "R0", "Rp", "Rd", "M", "h0", "Pext", "gamma_profile",
    "to_save", "initial_pressure", "initial_flow", "visco-elastic",
))  # fmt: skip
SPACED: Final = "gamma profile"
"""As openBF's manual and models wrote ``gamma_profile``."""
_KINDS: Final = {"reflection": {"Rt"}, "wk2": {"R1", "Cc"}, "wk3": {"R1", "Cc"}}
"""Keys that the word under ``outlet`` needs."""

Entry = tuple[Mapping[str, Any], str]
"""A vessel's keys, and what messages call it."""


@dataclass(frozen=True)
class OpenBFCase:
    """What an openBF file asks for, in our units.

    Attributes
    ----------
    project : str
    labels : (v,) tuple of str
        Names of the vessels.
    network : VesselNetwork
        Lengths and radii as the file has them. It gives no places: every vessel goes out from one
        point and back.
    conditions : PulsatileConditions
    options : OneDOptions
    quantities : tuple of str
        Of `QUANTITIES`, to be written.
    shown : tuple of int
        Vessels to be written.
    folder : str or None
        ``output_directory``.
    tolerance_mmhg : float
        ``convergence_tolerance``.
    notes : tuple of str
        What the user should know of how the file was read.
    """

    project: str
    labels: tuple[str, ...]
    network: VesselNetwork
    conditions: PulsatileConditions
    options: OneDOptions
    quantities: tuple[str, ...]
    shown: tuple[int, ...]
    folder: str | None
    tolerance_mmhg: float
    notes: tuple[str, ...] = ()


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
    labels = _labels(listed)
    both = [(data, f"vessel {label}") for data, label in zip(listed, labels, strict=True)]
    for data, place in both:
        _refuse_initial_state(data, place)
    nodes, is_outlet = _nodes(both)
    lengths = np.array([quantity(d, "L", p, (1e-6, 1e3)) for d, p in both])
    network = _network(
        nodes, lengths * SI.mm_per_m, np.array([_radii(d, p) for d, p in both]) * SI.mm_per_m
    )
    walls = _walls(both)
    cells = [_cells(d, p, x) for (d, p), x in zip(both, lengths.tolist(), strict=True)]
    exponents = [quantity(d, "gamma_profile", p, (2.0, 100.0), 2.0) for d, p in both]
    shown = tuple(k for k, (d, p) in enumerate(both) if flag(d, "to_save", p, default=True))
    outlets, reflection = _outlets(both, is_outlet, network, walls, density)
    count = len(labels)
    return OpenBFCase(
        project=text(given, "project_name", "the file"),
        labels=labels,
        network=network,
        conditions=PulsatileConditions(
            viscosity_pa_s=quantity(blood, "mu", "blood", (1e-9, 1e3)),
            inlet=_inlet_wave(inlet),
            outlet=outlets,
            wall=walls,
            density=density,
        ),
        options=OneDOptions(
            cell_mm=network.lengths() / cells,
            profile_exponent=np.array(exponents),
            alpha=1.0,
            reflection=reflection,
            courant=quantity(solver, "Ccfl", "solver", (0.01, 1.0)),
            samples=whole(solver, "jump", "solver", 8),
            most_cycles=max(_MIN_CYCLES, whole(solver, "cycles", "solver", 1)),
            probes=Probes(np.repeat(np.arange(count), len(PLACES)), np.tile(PLACES, count)),
        ),
        quantities=_quantities(given),
        shown=shown,
        folder=text(given, "output_directory", "the file") if "output_directory" in given else None,
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
        return Tabulated(table[:, 0], table[:, 1] * SI.ul_per_m3)
    except FlowError as exc:
        raise FlowError(f"inlet_file: {exc}") from exc


def _quantities(given: Mapping[str, Any]) -> tuple[str, ...]:
    listed = entries(given, "write_results") if "write_results" in given else list(QUANTITIES)
    if not listed:
        raise FlowError(f"write_results is empty; write {', '.join(QUANTITIES)}, or leave it out")
    for name in listed:
        if name not in QUANTITIES:
            raise FlowError(
                f"write_results: {name!r} isn't written by openBF; write {', '.join(QUANTITIES)}"
            )
    return tuple(name for name in QUANTITIES if name in listed)


# Vessels of the list ``network``: ends, lengths, radii, walls and outlets.


def _labels(listed: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    labels = tuple(text(v, "label", f"network[{k}]") for k, v in enumerate(listed))
    for label in labels:
        if labels.count(label) > 1:
            raise FlowError(f"network: the label {label!r} stands twice; give each its own")
    return labels


def _refuse_initial_state(data: Mapping[str, Any], place: str) -> None:
    for key in ("initial_pressure", "initial_flow"):
        if quantity(data, key, place, (-math.inf, math.inf), 0.0) != 0.0:
            raise FlowError(
                f"{place}: {key} isn't 0; the periodic state, which is what is solved for, "
                "doesn't depend on it: leave it out"
            )


def _nodes(both: Sequence[Entry]) -> tuple[IntArray, list[bool]]:
    """First and last node of each vessel from 0, and whether it ends in an outlet.

    Every outlet has a node of its own: where openBF's vessels end in one, they don't meet.
    """
    named = [(whole(d, "sn", p, 1), whole(d, "tn", p, 1)) for d, p in both]
    starts, stops = {sn for sn, _ in named}, {tn for _, tn in named}
    inlets = [p for (_, p), (sn, _) in zip(both, named, strict=True) if sn not in stops]
    if len(inlets) != 1:
        what = f"{', '.join(inlets[:3])} begin" if inlets else "none begins"
        raise FlowError(f"sn: one vessel begins where none ends, the inlet; here {what} there")
    number = {node: k for k, node in enumerate(sorted(starts))}
    is_outlet, ends = [], []
    for (_, place), (sn, tn) in zip(both, named, strict=True):
        if sn == tn:
            raise FlowError(f"{place}: sn and tn are both {sn}; a vessel joins two nodes")
        is_outlet.append(tn not in starts)
        last = len(starts) + sum(is_outlet) - 1 if is_outlet[-1] else number[tn]
        ends.append((number[sn], last))
    return np.array(ends), is_outlet


def _radii(data: Mapping[str, Any], place: str) -> tuple[float, float]:
    """Radius at the first and last node, m."""
    if "Rp" in data and "R0" in data:
        raise FlowError(f"{place}: R0 is given, and Rp; leave one of them out")
    if "Rp" not in data and "R0" not in data:
        raise FlowError(f"{place}: R0 is missing, and Rp; give one of them, in m")
    first = quantity(data, "Rp" if "Rp" in data else "R0", place, (1e-7, 1.0))
    return first, quantity(data, "Rd", place, (1e-7, 1.0), first)


def _walls(both: Sequence[Entry]) -> VesselWalls:
    thickness = [quantity(d, "h0", p, (1e-9, 1.0)) if "h0" in d else math.nan for d, p in both]
    return VesselWalls(
        young_pa=np.array([quantity(d, "E", p, (1e-3, 1e15)) for d, p in both]),
        thickness_mm=np.array(thickness) * SI.mm_per_m,
        external_pa=np.array([quantity(d, "Pext", p, (-1e9, 1e9), 0.0) for d, p in both]),
        viscous=np.array([flag(d, "visco-elastic", p, default=False) for d, p in both]),
    )


def _cells(data: Mapping[str, Any], place: str, length_m: float) -> int:
    """Cells of openBF's mesh: as given, five at least, none longer than 1 mm."""
    return max(5, whole(data, "M", place, 1, 5), math.ceil(length_m * 1e3))


def _network(nodes: IntArray, lengths: FloatArray, radii: FloatArray) -> VesselNetwork:
    """Vessels that go out from one point and back, the taper in a straight line, mm."""
    count = len(nodes)
    points = np.zeros((count, 3, 3))
    points[:, 1, 0] = lengths / 2.0
    return VesselNetwork(
        nodes=np.zeros((int(nodes.max()) + 1, 3)),
        vessel_nodes=nodes,
        kind=np.full(count, int(VesselKind.ARTERY)),
        tree=np.zeros(count, dtype=np.int64),
        offset=3 * np.arange(count + 1),
        points=points.reshape(-1, 3),
        radius=np.column_stack([radii[:, 0], radii.mean(axis=1), radii[:, 1]]).ravel(),
    )


def _outlets(
    both: Sequence[Entry],
    is_outlet: Sequence[bool],
    network: VesselNetwork,
    walls: VesselWalls,
    density: float,
) -> tuple[dict[int, Outlet], dict[int, float]]:
    """Condition of each outlet's node, and which part of a wave reflecting ones send back."""
    radius = network.radius[2::3]
    stiff = walls.stiffness(np.arange(len(both)), radius)
    impedance = np.sqrt(density * stiff / 2.0) / (np.pi * radius**2) * 1e9
    outlets: dict[int, Outlet] = {}
    reflection: dict[int, float] = {}
    for k, (data, place) in enumerate(both):
        if not is_outlet[k]:
            _refuse_outlet_keys(data, place)
            continue
        node = int(network.vessel_nodes[k, 1])
        outlets[node], part = outlet_of(
            data, place, float(impedance[k]), float(walls.external_pa[k])
        )
        if part is not None:
            reflection[node] = part
    return outlets, reflection


def outlet_of(
    data: Mapping[str, Any], place: str, impedance: float, external_pa: float
) -> tuple[Outlet, float | None]:
    """Return the outlet's condition and, of a reflecting one, which part it sends back.

    As openBF runs it: R₁ from the vessel's end to the compliance, R₂ from there to `Pout`.
    Without R₂, R₂ = R₁ - ``impedance`` (ϱ c/A at rest, Pa·s/m³), and R₁ stays.

    Raises
    ------
    FlowError
        For keys that don't go together, are missing or out of bounds.
    """
    given = {key for key in OUTLET if key in data}
    _check_word(data, given, place)
    if flag(data, "inlet_impedance_matching", place, default=False):
        raise FlowError(
            f"{place}: inlet_impedance_matching isn't modelled; write false, and for R1 the "
            f"impedance at rest, {impedance:.6g}, with what is left of the sum for R2"
        )
    if "Rt" in given:
        others = sorted(given & {"R1", "R2", "Cc", "Pout"})
        if others:
            raise FlowError(f"{place}: Rt doesn't go with {others[0]}; leave one of them out")
        part = quantity(data, "Rt", place, (-1.0, 1.0))
        return PressureOutlet(Constant(external_pa)), part
    if not given & {"R1", "R2", "Cc"}:
        raise FlowError(f"{place} ends in an outlet; give it R1 and Cc (and R2), or Rt")
    proximal = quantity(data, "R1", place, (1e-3, 1e30))
    distal = quantity(data, "R2", place, (0.0, 1e30), 0.0) or proximal - impedance
    if distal <= 0.0:
        raise FlowError(
            f"{place}: R1 is {proximal:g} and without R2 has to be above the vessel's impedance, "
            f"{impedance:.6g} Pa·s/m³; raise R1, or give R2"
        )
    compliance = quantity(data, "Cc", place, (1e-30, 1.0))
    back = quantity(data, "Pout", place, (-1e9, 1e9), 0.0)
    si = SI.pa_s_ul_per_pa_s_m3
    return WindkesselOutlet(proximal * si, compliance / si, distal * si, back), None


def _refuse_outlet_keys(data: Mapping[str, Any], place: str) -> None:
    """Raise `FlowError` where a vessel that others follow has an outlet's keys."""
    matched = flag(data, "inlet_impedance_matching", place, default=False)
    for key in sorted(OUTLET & data.keys() - {"inlet_impedance_matching"}):
        raise FlowError(f"{place}: {key} is for outlets, and other vessels follow; leave it out")
    if matched:
        raise FlowError(f"{place}: inlet_impedance_matching is for outlets; leave it out")


def _check_word(data: Mapping[str, Any], given: set[str], place: str) -> None:
    """Hold the word of older files, which openBF no longer reads, against the numbers."""
    if "outlet" not in given:
        return
    word = data["outlet"]
    if word not in _KINDS:
        raise FlowError(f"{place}: outlet is {word!r}; write {', '.join(_KINDS)}, or leave it out")
    missing = sorted(_KINDS[word] - given)
    if missing or (word == "wk2" and "R2" in given):
        what = f"has no {missing[0]}" if missing else "has R2"
        raise FlowError(f"{place}: outlet is {word} and {what}; make them agree")


def section(data: Any, place: str, known: frozenset[str]) -> Mapping[str, Any]:
    """Return ``data`` as a mapping of known keys; a key's words may have spaces between them.

    Raises
    ------
    FlowError
        When it isn't one, has a key that openBF doesn't read, or one twice.
    """
    if not isinstance(data, Mapping):
        return check_keys(data, place, known)
    named: dict[Any, Any] = {}
    for key, value in data.items():
        if not isinstance(key, str) or key.startswith("_"):
            raise FlowError(f"{place} has the key {key!r}, which openBF doesn't read; take it out")
        name = key.replace(" ", "_")
        name = name if name in known else key
        if name in named:
            raise FlowError(f"{place} has the keys {name!r} and {key!r}; leave one of them out")
        named[name] = value
    return check_keys(named, place, known)


def quantity(
    data: Mapping[str, Any],
    key: str,
    place: str,
    limits: tuple[float, float],
    default: float | None = None,
) -> float:
    """Return the number under ``key``, within ``limits``; 1e-13 without a point is one, too.

    Raises
    ------
    FlowError
        When it is missing, no number or out of its limits.
    """
    value = data.get(key)
    if isinstance(value, str):
        with suppress(ValueError):  # `number` refuses it by name
            data = {key: float(value)}
    amount = number(data, key, place, default)
    low, high = limits
    if not low <= amount <= high:
        raise FlowError(f"{place}: {key} is {amount:g}; write {low:g} to {high:g}")
    return amount


# Run an openBF case: waves at five places of its vessels, in SI units.

_TO_SI: Final = {"P": 1.0, "Q": 1e-9, "A": 1e-6, "u": 1e-3}


@dataclass(frozen=True)
class OpenBFWaves:
    """Waves of the vessels to be written.

    Attributes
    ----------
    labels : (n,) tuple of str
    time_s : (t,) float64
        Of one cycle, its end left out.
    waves : dict of str to (n, 5, t) float64, SI units
        By quantity, at 0, ¼, ½, ¾ and all of each vessel's length.
    """

    labels: tuple[str, ...]
    time_s: FloatArray
    waves: dict[str, FloatArray]


def run_openbf(
    case: OpenBFCase, progress: Progress | None = None
) -> tuple[OneDSolution, OpenBFWaves]:
    """Find the periodic state, to 10⁻⁴ of the swing and to ``convergence_tolerance``.

    Raises
    ------
    FlowError
        As `solve_one_d`.
    """
    solution = solve_one_d(case.network, case.conditions, case.options, progress)
    swing = float(np.ptp(solution.pressure)) / PA_PER_MMHG
    if solution.change[-1] * swing > case.tolerance_mmhg:
        closer = replace(case.options, tolerance=case.tolerance_mmhg / swing)
        solution = solve_one_d(case.network, case.conditions, closer, progress)
    return solution, _waves(case, solution)


def _waves(case: OpenBFCase, solution: OneDSolution) -> OpenBFWaves:
    if solution.probes is None or solution.probe_area is None:
        raise ValueError("an openBF case has probes")
    flow, area = solution.probes.flow, solution.probe_area
    waves = dict(zip(QUANTITIES, (solution.probes.pressure, flow, area, flow / area), strict=True))
    shape = (len(case.labels), len(PLACES), -1)
    shown = list(case.shown)
    return OpenBFWaves(
        labels=tuple(case.labels[k] for k in shown),
        time_s=solution.time_s,
        waves={q: waves[q].reshape(shape)[shown] * _TO_SI[q] for q in case.quantities},
    )
