"""Read hearts, valves, chambers and couplings of svZeroDSolver's input."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod.blocks import Blocks
from design.hemodynamics.zero_d.svzerod.closed_loop import HEART
from design.hemodynamics.zero_d.svzerod.elements import (
    CHAMBERS,
    COUPLINGS,
    HEARTS,
    JUNCTIONS,
    VALVES,
    VESSELS,
)
from design.hemodynamics.zero_d.svzerod.keys import check_keys, flag, number, text

_OF_HEART: Final = frozenset((
    "name", "closed_loop_type", "cardiac_cycle_period", "parameters", "outlet_blocks",
))  # fmt: skip
_OF_VALVE: Final = frozenset(("name", "type", "params"))
_OF_CHAMBER: Final = frozenset(("name", "type", "values", "activation_function"))
_OF_COUPLING: Final = frozenset((
    "name", "type", "location", "connected_block", "values", "periodic",
))  # fmt: skip
_SIDES: Final = frozenset(("upstream_block", "downstream_block"))
_INLET, _OUTLET = "J_heart_inlet", "J_heart_outlet"
_HEART_KIND: Final = "ClosedLoopHeartAndPulmonary"
_MUSCLES: Final = {"ClosedLoopCoronaryLeft": "iml", "ClosedLoopCoronaryRight": "imr"}
_BEFORE: Final = frozenset((*VESSELS, *_MUSCLES, "RESISTANCE", "RCR", "ClosedLoopRCR", "CORONARY"))
_BEHIND: Final = frozenset((*VESSELS, "ClosedLoopRCR"))
"""Kinds of block that a coupling may stand before, and behind."""


def read_couplings(blocks: Blocks, listed: list[Any]) -> None:
    """Add the conditions that stand for another solver; they are tables like any others.

    Raises
    ------
    FlowError
        As `Blocks.add`, and for tables that another solver would drive.
    """
    for k, data in enumerate(listed):
        place = f"external_solver_coupling_blocks[{k}]"
        check_keys(data, place, _OF_COUPLING)
        name = text(data, "name", place)
        if not flag(data, "periodic", place, default=True):
            raise FlowError(f"{place}: periodic is false; that needs the 3D solver that drives it")
        if data.get("location") not in ("inlet", "outlet"):
            raise FlowError(f"{place}: location is {data.get('location')!r}; write inlet or outlet")
        blocks.add(name, f"coupling {name}", COUPLINGS, data, ("type", "values"))


def join_couplings(blocks: Blocks, listed: list[Any]) -> None:
    """Connect couplings with their blocks; those of the heart stand in its outlet_blocks.

    Raises
    ------
    FlowError
        For a block that isn't given, or of a kind that isn't coupled.
    """
    kinds = {block.name: block.kind for block in blocks.found}
    for data in listed:
        name, other = data["name"], text(data, "connected_block", f"coupling {data['name']}")
        place = f"coupling {name}: connected_block"
        inlet = data["location"] == "inlet"
        if other == _HEART_KIND and not inlet:
            continue
        if other in kinds and kinds[other] not in (_BEFORE if inlet else _BEHIND):
            raise FlowError(
                f"{place} is {other!r}, a {kinds[other]}, which isn't coupled at its "
                f"{data['location']}"
            )
        before, behind = (name, other) if inlet else (other, name)
        blocks.wiring.join(before, behind, place)


def read_heart(blocks: Blocks, listed: list[Any]) -> Mapping[str, Any] | None:
    """Add the heart and the junctions before and behind it; return what the file says of it.

    Raises
    ------
    FlowError
        For more than one, and as `Blocks.add`.
    """
    if len(listed) > 1:
        raise FlowError(f"closed_loop_blocks has {len(listed)} hearts; give one")
    if not listed:
        return None
    place = "closed_loop_blocks[0]"
    data = check_keys(listed[0], place, _OF_HEART)
    blocks.add(HEART, place, HEARTS, data, ("closed_loop_type", "parameters"))
    period = number(data, "cardiac_cycle_period", place)
    if period <= 0.0:
        raise FlowError(f"{place}: cardiac_cycle_period is {period:g}; write a number above 0")
    blocks.tables.agree(period, f"{place}: cardiac_cycle_period")
    for name in (_INLET, _OUTLET):
        blocks.add(name, name, JUNCTIONS, {"type": "NORMAL_JUNCTION"}, ("type", "values"))
    return data


def join_heart(blocks: Blocks, data: Mapping[str, Any] | None, loops: list[str]) -> None:
    """Connect the heart with what leads back into it and what it feeds.

    Raises
    ------
    FlowError
        When a loop's end has no heart, or the heart feeds nothing or nothing leads back.
    """
    if data is None:
        if loops:
            raise FlowError(f"boundary condition {loops[0]} needs a heart (closed_loop_blocks)")
        return
    place = "closed_loop_blocks[0]"
    outlets = data.get("outlet_blocks")
    if not isinstance(outlets, list) or not outlets or not all(isinstance(x, str) for x in outlets):
        raise FlowError(f"{place}: outlet_blocks isn't a list of names")
    if not loops:
        raise FlowError(f"{place}: no boundary condition leads back (closed_loop_outlet: true)")
    wiring = blocks.wiring
    wiring.join(_INLET, HEART, place)
    for name in loops:
        wiring.join(name, _INLET, place)
    wiring.join(HEART, _OUTLET, place)
    for name in outlets:
        wiring.join(_OUTLET, name, f"{place}: outlet_blocks")
    heart = next(block for block in blocks.found if block.name == HEART)
    for block in blocks.found:
        if block.kind in _MUSCLES:
            block.more.append(number(heart.given, _MUSCLES[block.kind], place))


def read_valves(blocks: Blocks, listed: list[Any]) -> list[tuple[str, str, str]]:
    """Add the valves; return which blocks to join, and the place for messages.

    Raises
    ------
    FlowError
        As `Blocks.add`.
    """
    joins = []
    for k, data in enumerate(listed):
        check_keys(data, f"valves[{k}]", _OF_VALVE)
        name = text(data, "name", f"valves[{k}]")
        place = f"valve {name}"
        given = blocks.add(name, place, VALVES, data, ("type", "params"), _SIDES).given
        upstream, downstream = (
            text(given, f"{s}_block", place) for s in ("upstream", "downstream")
        )
        joins += [
            (upstream, name, f"{place}: upstream_block"),
            (name, downstream, f"{place}: downstream_block"),
        ]
    return joins


def read_chambers(blocks: Blocks, listed: list[Any]) -> None:
    """Add the chambers.

    Raises
    ------
    FlowError
        As `Blocks.add`.
    """
    for k, data in enumerate(listed):
        check_keys(data, f"chambers[{k}]", _OF_CHAMBER)
        name = text(data, "name", f"chambers[{k}]")
        place = f"chamber {name}"
        chamber = blocks.add(name, place, CHAMBERS, data, ("type", "values"))
        if chamber.kind != "ChamberSphere":
            chamber.activates = data.get("activation_function", {})
        elif "activation_function" in data:
            raise FlowError(f"{place}: activation_function isn't a ChamberSphere's; leave it out")
