"""Number an svZeroDSolver case's variables; build its equations and initial state."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import Final

import numpy as np

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod.case import Block, SvZeroDCase
from design.hemodynamics.zero_d.svzerod.elements import ELEMENTS, Element
from design.hemodynamics.zero_d.svzerod.stamps import Group, LumpedSystem, Stamps
from kernels.arrays import FloatArray, IntArray

_ALL_OF: Final = {"pressure_all": ("pressure:", "P_c:"), "flow_all": ("flow:",)}
"""Initial values of many variables, by how their names begin."""


@dataclass(frozen=True)
class Variables:
    """Variables of a case, in svZeroDSolver's order.

    Flow and pressure of each connection, then those of the blocks' own.

    Attributes
    ----------
    names : tuple of str
    groups : tuple of (kind, Group)
    """

    names: tuple[str, ...]
    groups: tuple[tuple[str, Group], ...]


def variables_of(case: SvZeroDCase) -> Variables:
    """Number the variables and equations of a case."""
    names = [f"{what}:{name}" for name in case.connections for what in ("flow", "pressure")]
    alike: dict[tuple[str, int, int], list[tuple[Block, list[int], int]]] = defaultdict(list)
    equations = 0
    for block in case.blocks:
        element = ELEMENTS[block.kind]
        own = list(range(len(names), len(names) + len(element.own)))
        names += [f"{name}:{block.name}" for name in element.own]
        alike[block.kind, len(block.inlets), len(block.outlets)].append((block, own, equations))
        equations += _equations(element, block)
    if equations != len(names):
        raise FlowError(f"{equations} equations for {len(names)} variables: blocks are left open")
    return Variables(
        tuple(names), tuple((key[0], _group(key[0], members)) for key, members in alike.items())
    )


def _equations(element: Element, block: Block) -> int:
    """Return the number of equations: half of the connections' variables, and its own."""
    return len(block.inlets) + len(block.outlets) + len(element.own)


def _group(kind: str, members: list[tuple[Block, list[int], int]]) -> Group:
    ports = np.array([block.inlets + block.outlets for block, _, _ in members])
    own = np.array([own for _, own, _ in members], dtype=np.int64)
    each = np.stack([2 * ports + 1, 2 * ports], axis=2).reshape(len(members), -1)
    count = _equations(ELEMENTS[kind], members[0][0])
    first = np.array([start for _, _, start in members])
    return Group(
        values=np.array([block.values for block, _, _ in members]),
        tables=np.array([block.table for block, _, _ in members]),
        variables=np.concatenate([each, own], axis=1),
        equations=first[:, None] + np.arange(count),
        inlets=len(members[0][0].inlets),
        ports=ports.shape[1],
        activations=tuple(block.activation for block, _, _ in members if block.activation),
    )


def system_of(
    variables: Variables, sampled: FloatArray, state: FloatArray, rates: FloatArray, *, steady: bool
) -> LumpedSystem:
    """Return the equations.

    Parameters
    ----------
    sampled : (tables,) float64
        Values of the tables at the begin.
    state, rates : (n,) float64
        At the begin; coronaries count their volume from there.
    steady : bool
        Whether for the steady start, without the outlets' storage.
    """
    places = {name: k for k, name in enumerate(variables.names)}
    stamps = Stamps(len(state), len(sampled), steady, state, rates, sampled, places)
    for kind, group in variables.groups:
        stamps.group = group
        ELEMENTS[kind].stamp(group, stamps)
    return stamps.system()


def start_of(case: SvZeroDCase, names: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
    """Return values and rates at the begin, (n,) each."""
    place: dict[str, int] = {name: k for k, name in enumerate(names)}
    state, rates = np.zeros(len(names)), np.zeros(len(names))
    for key, prefixes in _ALL_OF.items():
        if key in case.initial:
            state[_begin_with(names, prefixes)] = case.initial[key]
    for given, to in ((case.initial, state), (case.initial_rates, rates)):
        for name, value in given.items():
            if name in place:
                to[place[name]] = value
    return state, rates


def unused_initial(case: SvZeroDCase, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return initial values of no variable, which svZeroDSolver passes over without a word."""
    known = set(names)
    unused = [name for name in case.initial if name not in known and name not in _ALL_OF]
    return tuple(dict.fromkeys(unused + [name for name in case.initial_rates if name not in known]))


def _begin_with(names: tuple[str, ...], prefixes: tuple[str, ...]) -> IntArray:
    return np.array([k for k, name in enumerate(names) if name.startswith(prefixes)], dtype=int)
