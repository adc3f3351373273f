"""Read svZeroDSolver's JSON input as a circuit for the pulsatile 0D solver.

Format: the project's documentation and test cases (github.com/SimVascular/svZeroDSolver). Every
key is either followed or refused by name and place. Chambers, valves, closed loops and blocks
coupled to another solver are refused.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod.case import Block, SvZeroDCase
from design.hemodynamics.zero_d.svzerod.elements import (
    CONDITIONS,
    JUNCTIONS,
    VESSELS,
    Element,
)
from design.hemodynamics.zero_d.svzerod.keys import (
    check_keys,
    entries,
    number,
    numbers,
    parse_json,
    text,
)
from design.hemodynamics.zero_d.svzerod.options import PLACE, options_of
from design.hemodynamics.zero_d.svzerod.tables import Tables
from design.hemodynamics.zero_d.svzerod.wiring import Wiring, join_conditions, join_junction
from design.network import FloatArray

_FOREIGN: Final = {
    "chambers": "no heart is modelled",
    "closed_loop_blocks": "no heart is modelled",
    "external_solver_coupling_blocks": "no other solver drives it",
    "valves": "no valve is modelled",
    "calibration_parameters": "printctl doesn't calibrate",
    "y": "printctl doesn't calibrate",
    "dy": "printctl doesn't calibrate",
}
_LISTS: Final = ("vessels", "boundary_conditions", "junctions")
_KNOWN: Final = frozenset(
    (*_LISTS, PLACE, "initial_condition", "initial_condition_d", "description", *_FOREIGN)
)
_OF_VESSEL: Final = frozenset((
    "vessel_id", "vessel_name", "vessel_length", "boundary_conditions", "zero_d_element_type",
    "zero_d_element_values",
))  # fmt: skip
_OF_CONDITION: Final = frozenset(("bc_name", "bc_type", "bc_values"))
_OF_JUNCTION: Final = frozenset((
    "junction_name", "junction_type", "junction_values", "inlet_vessels", "outlet_vessels",
    "inlet_blocks", "outlet_blocks",
))  # fmt: skip


def read_svzerod(path: Path) -> SvZeroDCase:
    """Read a file.

    Raises
    ------
    FlowError
        When it isn't such a file, or asks for what isn't modelled here.
    OSError
        When it can't be read.
    """
    try:
        return case_of(parse_json(path.read_text(encoding="utf-8")))
    except UnicodeDecodeError as exc:
        raise FlowError(f"{path} isn't text in UTF-8: {exc}") from exc
    except FlowError as exc:
        raise FlowError(f"{path}: {exc}") from exc


def case_of(data: Any) -> SvZeroDCase:
    """Return the case that parsed JSON describes.

    Raises
    ------
    FlowError
        For a key or kind that isn't modelled, and for what is missing or wrong.
    """
    if isinstance(data, Mapping):
        for key, why in _FOREIGN.items():
            if data.get(key):
                raise FlowError(f"{key}: {why}; use svZeroDSolver for this file")
    given = check_keys(data, "the file", _KNOWN)
    options = options_of(given.get(PLACE))
    tables = Tables(options.cardiac_period)
    blocks, wiring = _Reader(given, tables).read()
    return SvZeroDCase(
        blocks=tuple(blocks),
        vessels=len(given["vessels"]),
        connections=tuple(wiring.names),
        options=options,
        period=tables.period or 1.0,
        tables=tables,
        initial=_initial(given, "initial_condition"),
        initial_rates=_initial(given, "initial_condition_d"),
    )


def _initial(data: Mapping[str, Any], key: str) -> dict[str, float]:
    given = data.get(key, {})
    if not isinstance(given, Mapping):
        raise FlowError(f"{key} isn't an object of variables and numbers")
    return {name: number(given, name, key) for name in given if not name.startswith("_")}


class _Reader:
    """Blocks of a file, wired in svZeroDSolver's order."""

    def __init__(self, data: Mapping[str, Any], tables: Tables) -> None:
        self.vessels, self.conditions, self.junctions = (entries(data, key) for key in _LISTS)
        if not self.vessels:
            raise FlowError("vessels: none is given")
        self.tables, self.wiring = tables, Wiring()
        self.found: list[tuple[str, str, str, Element, Mapping[str, Any]]] = []

    def read(self) -> tuple[list[Block], Wiring]:
        """Return blocks and their connections."""
        numbered: dict[int, str] = {}
        for k, vessel in enumerate(self.vessels):
            self._vessel(vessel, f"vessels[{k}]", numbered)
        for k, condition in enumerate(self.conditions):
            self._condition(condition, f"boundary_conditions[{k}]")
        names = [self._junction(j, f"junctions[{k}]") for k, j in enumerate(self.junctions)]
        join_conditions(self.wiring, self.vessels)
        for junction, name in zip(self.junctions, names, strict=True):
            join_junction(self.wiring, junction, name, numbered)
        return [self._block(*parts) for parts in self.found], self.wiring

    def _vessel(self, vessel: Any, place: str, numbered: dict[int, str]) -> None:
        check_keys(vessel, place, _OF_VESSEL)
        name = text(vessel, "vessel_name", place)
        place = f"vessel {name}"
        identity = vessel.get("vessel_id")
        if isinstance(identity, bool) or not isinstance(identity, int) or identity in numbered:
            raise FlowError(f"{place}: vessel_id is {identity!r}; write an integer of its own")
        numbered[identity] = name
        self._add(name, place, VESSELS, vessel, "zero_d_element_type", "zero_d_element_values")

    def _condition(self, condition: Any, place: str) -> None:
        check_keys(condition, place, _OF_CONDITION)
        name = text(condition, "bc_name", place)
        self._add(name, f"boundary condition {name}", CONDITIONS, condition, "bc_type", "bc_values")

    def _junction(self, junction: Any, place: str) -> str:
        check_keys(junction, place, _OF_JUNCTION)
        name = text(junction, "junction_name", place)
        self._add(name, f"junction {name}", JUNCTIONS, junction, "junction_type", "junction_values")
        return name

    def _add(
        self, name: str, place: str, kinds: Mapping[str, Element], data: Mapping[str, Any],
        type_key: str, values_key: str,
    ) -> None:  # fmt: skip
        kind = data.get(type_key)
        if not isinstance(kind, str) or kind not in kinds:
            raise FlowError(
                f"{place}: {type_key} is {kind!r}, which isn't modelled; known: "
                + ", ".join(sorted(kinds))
            )
        element = kinds[kind]
        given = check_keys(data.get(values_key, {}), f"{place}: {values_key}", element.known)
        self.wiring.add_block(name, place)
        self.found.append((name, kind, place, element, given))

    def _block(
        self, name: str, kind: str, place: str, element: Element, given: Mapping[str, Any]
    ) -> Block:
        self.wiring.check(name, element.ports, place)
        into, out = tuple(self.wiring.inlets[name]), tuple(self.wiring.outlets[name])
        table = -1
        if element.table:
            value = numbers(given, element.table, place)
            time = numbers(given, "t", place) if len(value) > 1 or "t" in given else np.zeros(1)
            table = self.tables.add(time, value, f"{place}: {element.table}")
        many = element.ports == "many"
        values = _lists if many else _scalars
        return Block(
            name, kind, values(given, element, place, len(into), len(out)), table, into, out
        )


def _scalars(given: Mapping[str, Any], element: Element, place: str, *_: int) -> FloatArray:
    needed = [number(given, key, place) for key in element.needed]
    return np.array(needed + [number(given, k, place, v) for k, v in element.optional.items()])


def _lists(
    given: Mapping[str, Any], element: Element, place: str, into: int, out: int
) -> FloatArray:
    """Return a junction's numbers: one a connection, or one an outlet behind a single inlet."""
    if not element.needed:
        return np.zeros(0)
    count = into + out if element.needed == ("R",) else out
    if count == out and into != 1:
        raise FlowError(f"{place} has {into} inlet_vessels; its type takes one")
    found = [numbers(given, key, place) for key in element.needed]
    for key, value in zip(element.needed, found, strict=True):
        if len(value) != count:
            raise FlowError(f"{place}: {key} has {len(value)} numbers; it needs {count}")
    return np.concatenate(found)
