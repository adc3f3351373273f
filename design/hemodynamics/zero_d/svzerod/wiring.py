"""Connect blocks of svZeroDSolver's input: vessels, junctions and boundary conditions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod.keys import check_keys, text

_SIDES = frozenset(("inlet", "outlet"))


@dataclass
class Wiring:
    """Connections by the names of the blocks that they join, in svZeroDSolver's order.

    Attributes
    ----------
    names : list of str
    inlets, outlets : dict of str to list of int
        Connections of each block.
    """

    names: list[str] = field(default_factory=list)
    inlets: dict[str, list[int]] = field(default_factory=dict)
    outlets: dict[str, list[int]] = field(default_factory=dict)

    def add_block(self, name: str, place: str) -> None:
        """Make a block known.

        Raises
        ------
        FlowError
            When another block has the name.
        """
        if name in self.inlets:
            raise FlowError(f"{place}: another block is named {name!r}, too")
        self.inlets[name], self.outlets[name] = [], []

    def join(self, first: str, last: str, place: str) -> None:
        """Connect two blocks.

        Raises
        ------
        FlowError
            When one of them isn't given.
        """
        for name in (first, last):
            if name not in self.inlets:
                raise FlowError(f"{place} names {name!r}, which isn't given")
        self.outlets[first].append(len(self.names))
        self.inlets[last].append(len(self.names))
        self.names.append(f"{first}:{last}")

    def check(self, name: str, ports: str, place: str) -> None:
        """Check that a block has the connections it needs.

        Raises
        ------
        FlowError
            When it has too few or too many.
        """
        into, out = len(self.inlets[name]), len(self.outlets[name])
        good = {
            "one": into + out == 1,
            "two": into == out == 1,
            "many": into >= 1 and out >= 1,
        }[ports]
        if not good:
            wants = {
                "one": "one vessel end",
                "two": "one inlet and one outlet",
                "many": "an inlet and an outlet at least",
            }[ports]
            raise FlowError(f"{place} has {into} inlets and {out} outlets; it needs {wants}")


def join_conditions(wiring: Wiring, vessels: list[Any]) -> None:
    """Connect vessels with their boundary conditions.

    Raises
    ------
    FlowError
        For a key that isn't known, a condition that isn't given.
    """
    for vessel in vessels:
        name = vessel["vessel_name"]
        place = f"vessel {name}: boundary_conditions"
        sides = check_keys(vessel.get("boundary_conditions", {}), place, _SIDES)
        if "inlet" in sides:
            wiring.join(text(sides, "inlet", place), name, place)
        if "outlet" in sides:
            wiring.join(name, text(sides, "outlet", place), place)


def join_junction(
    wiring: Wiring, junction: Mapping[str, Any], name: str, vessels: Mapping[int, str]
) -> None:
    """Connect a junction with its vessels (by number) or blocks (by name).

    Raises
    ------
    FlowError
        When neither pair of lists is whole, both are given, or a block isn't given.
    """
    place = f"junction {name}"
    kinds = [
        k for k in ("vessels", "blocks") if f"inlet_{k}" in junction or f"outlet_{k}" in junction
    ]
    if len(kinds) != 1:
        raise FlowError(
            f"{place} needs inlet_vessels and outlet_vessels, or inlet_blocks and outlet_blocks"
        )
    for side in ("inlet", "outlet"):
        key = f"{side}_{kinds[0]}"
        listed = junction.get(key)
        if not isinstance(listed, list) or not listed:
            raise FlowError(f"{place}: {key} isn't a list of blocks")
        for block in listed:
            wiring.join(*_pair(name, side, _other(block, vessels, kinds[0])), f"{place}: {key}")


def _other(block: Any, vessels: Mapping[int, str], by: str) -> str:
    """Return the name of a block that a junction lists."""
    if by == "vessels" and isinstance(block, int) and not isinstance(block, bool):
        return vessels.get(block, f"vessel {block}")
    return block if by == "blocks" and isinstance(block, str) else f"{block!r}"


def _pair(junction: str, side: str, other: str) -> tuple[str, str]:
    return (other, junction) if side == "inlet" else (junction, other)
