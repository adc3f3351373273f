"""Read svZeroDSolver's JSON input as a case: connected blocks, tables and solver options.

Format: the project's documentation and test cases (github.com/SimVascular/svZeroDSolver). Every
key is either followed or refused by name and place. Chambers, valves and closed loops stand in
`read_heart`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod.blocks import Blocks
from design.hemodynamics.zero_d.svzerod.case import Block, SolverOptions, SvZeroDCase
from design.hemodynamics.zero_d.svzerod.elements import CONDITIONS, JUNCTIONS, VESSELS
from design.hemodynamics.zero_d.svzerod.keys import (
    check_keys,
    entries,
    flag,
    number,
    parse_json,
    text,
)
from design.hemodynamics.zero_d.svzerod.options import PLACE, options_of
from design.hemodynamics.zero_d.svzerod.read_heart import (
    join_couplings,
    join_heart,
    read_chambers,
    read_couplings,
    read_heart,
    read_valves,
)
from design.hemodynamics.zero_d.svzerod.tables import Tables
from design.hemodynamics.zero_d.svzerod.wiring import join_conditions, join_junction

_FOREIGN: Final = ("calibration_parameters", "y", "dy")
_LISTS: Final = ("vessels", "boundary_conditions", "junctions")
_KNOWN: Final = frozenset(
    (
        *_LISTS,
        PLACE,
        "initial_condition",
        "initial_condition_d",
        "description",
        *_FOREIGN,
        "chambers",
        "closed_loop_blocks",
        "external_solver_coupling_blocks",
        "valves",
    )
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

_VESSEL_KEYS: Final = ("zero_d_element_type", "zero_d_element_values")
_CONDITION_KEYS: Final = ("bc_type", "bc_values")
_JUNCTION_KEYS: Final = ("junction_type", "junction_values")


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
        for key in _FOREIGN:
            if data.get(key):
                raise FlowError(f"{key}: printctl doesn't calibrate; use svZeroDCalibrator")
    given = check_keys(data, "the file", _KNOWN)
    options = options_of(given.get(PLACE))
    reader = _Reader(given, options)
    blocks = reader.read()
    return SvZeroDCase(
        blocks=tuple(blocks),
        vessels=len(reader.vessels),
        connections=tuple(reader.blocks.wiring.names),
        options=options,
        period=reader.tables.period or 1.0,
        tables=reader.tables,
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

    def __init__(self, data: Mapping[str, Any], options: SolverOptions) -> None:
        self.data = data
        self.vessels, self.conditions, self.junctions = (entries(data, key) for key in _LISTS)
        self.tables = Tables(options.cardiac_period)
        self.blocks = Blocks(self.tables)
        self.numbered: dict[int, str] = {}

    def read(self) -> list[Block]:
        """Return the blocks."""
        blocks, wiring = self.blocks, self.blocks.wiring
        for k, vessel in enumerate(self.vessels):
            self._vessel(vessel, f"vessels[{k}]")
        couplings = entries(self.data, "external_solver_coupling_blocks")
        read_couplings(blocks, couplings)
        loops = [
            self._condition(condition, f"boundary_conditions[{k}]")
            for k, condition in enumerate(self.conditions)
        ]
        names = [self._junction(j, f"junctions[{k}]") for k, j in enumerate(self.junctions)]
        heart = read_heart(blocks, entries(self.data, "closed_loop_blocks"))
        valves = read_valves(blocks, entries(self.data, "valves"))
        read_chambers(blocks, entries(self.data, "chambers"))
        if not blocks.found:
            raise FlowError("vessels: none is given")
        join_conditions(wiring, self.vessels)
        join_couplings(blocks, couplings)
        for junction, name in zip(self.junctions, names, strict=True):
            join_junction(wiring, junction, name, self.numbered)
        join_heart(blocks, heart, [name for name in loops if name])
        for first, last, place in valves:
            wiring.join(first, last, place)
        return blocks.wired()

    def _vessel(self, vessel: Any, place: str) -> None:
        check_keys(vessel, place, _OF_VESSEL)
        name = text(vessel, "vessel_name", place)
        place = f"vessel {name}"
        identity = vessel.get("vessel_id")
        known = identity in self.numbered if isinstance(identity, int) else True
        if isinstance(identity, bool) or known:
            raise FlowError(f"{place}: vessel_id is {identity!r}; write an integer of its own")
        self.numbered[identity] = name
        self.blocks.add(name, place, VESSELS, vessel, _VESSEL_KEYS)

    def _condition(self, condition: Any, place: str) -> str:
        """Add a condition; return its name where it leads back into the heart, else ''."""
        check_keys(condition, place, _OF_CONDITION)
        name = text(condition, "bc_name", place)
        place = f"boundary condition {name}"
        closed = condition.get("bc_type") == "ClosedLoopRCR"
        also = frozenset(("closed_loop_outlet",)) if closed else frozenset[str]()
        added = self.blocks.add(name, place, CONDITIONS, condition, _CONDITION_KEYS, also)
        if closed and not flag(added.given, "closed_loop_outlet", place, default=False):
            return ""
        return name if added.kind.startswith("ClosedLoop") else ""

    def _junction(self, junction: Any, place: str) -> str:
        check_keys(junction, place, _OF_JUNCTION)
        name = text(junction, "junction_name", place)
        self.blocks.add(name, f"junction {name}", JUNCTIONS, junction, _JUNCTION_KEYS)
        return name
