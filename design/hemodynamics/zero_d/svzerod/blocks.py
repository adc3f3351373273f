"""Collect the blocks of svZeroDSolver's input by name, with their checked numbers."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod.activation import activation_of
from design.hemodynamics.zero_d.svzerod.case import Block
from design.hemodynamics.zero_d.svzerod.elements import Element, check_sign
from design.hemodynamics.zero_d.svzerod.keys import check_keys, number, numbers
from design.hemodynamics.zero_d.svzerod.tables import Tables
from design.hemodynamics.zero_d.svzerod.wiring import Wiring
from kernels.arrays import FloatArray

_NONE: frozenset[str] = frozenset()


@dataclass
class Found:
    """A block as read, before it is wired.

    Attributes
    ----------
    name, kind, place : str
        ``place`` is how messages name it.
    element : Element
    given : mapping
        Its values.
    activates : object
        What the file says of a chamber's activation; None for other kinds.
    more : list of float
        Numbers that another block gives it.
    """

    name: str
    kind: str
    place: str
    element: Element
    given: Mapping[str, Any]
    activates: Any = None
    more: list[float] = field(default_factory=list)


@dataclass
class Blocks:
    """Collector of blocks.

    Attributes
    ----------
    tables : Tables
    wiring : Wiring
    found : list of Found
        In the order of svZeroDSolver's variables.
    """

    tables: Tables
    wiring: Wiring = field(default_factory=Wiring)
    found: list[Found] = field(default_factory=list)

    def add(
        self, name: str, place: str, kinds: Mapping[str, Element], data: Mapping[str, Any],
        keys: tuple[str, str], also: Set[str] = _NONE,
    ) -> Found:  # fmt: skip
        """Add a block; ``keys`` are those of its kind and values, ``also`` values read elsewhere.

        Raises
        ------
        FlowError
            For a kind or key that isn't known, a name given twice.
        """
        type_key, values_key = keys
        kind = data.get(type_key)
        if not isinstance(kind, str) or kind not in kinds:
            raise FlowError(
                f"{place}: {type_key} is {kind!r}, which isn't modelled; known: "
                + ", ".join(sorted(kinds))
            )
        known = kinds[kind].known | also
        given = check_keys(data.get(values_key, {}), f"{place}: {values_key}", known)
        self.wiring.add_block(name, place)
        self.found.append(Found(name, kind, place, kinds[kind], given))
        return self.found[-1]

    def wired(self) -> list[Block]:
        """Return the blocks with their numbers.

        Raises
        ------
        FlowError
            For connections that are too few or many, and numbers that are missing or wrong.
        """
        return [self._block(part) for part in self.found]

    def _block(self, part: Found) -> Block:
        name, place, element = part.name, part.place, part.element
        self.wiring.check(name, element.ports, place)
        into, out = tuple(self.wiring.inlets[name]), tuple(self.wiring.outlets[name])
        table = -1
        if element.table:
            value = numbers(part.given, element.table, place)
            timed = len(value) > 1 or "t" in part.given
            time = numbers(part.given, "t", place) if timed else np.zeros(1)
            table = self.tables.add(time, value, f"{place}: {element.table}")
        values = _lists if element.ports == "many" else _scalars
        read = values(part.given, element, place, len(into), len(out))
        if part.more:
            read = np.append(read, part.more)
        active = None
        if part.activates is not None:
            active = activation_of(part.activates, place, self.tables.period)
        return Block(name, part.kind, read, table, into, out, element.written, active)


def _scalars(given: Mapping[str, Any], element: Element, place: str, *_: int) -> FloatArray:
    values = {key: number(given, key, place) for key in element.needed}
    values |= {k: number(given, k, place, default) for k, default in element.optional.items()}
    for key, value in values.items():
        check_sign(value, key, place)
    return np.array(list(values.values()))


def _lists(
    given: Mapping[str, Any], element: Element, place: str, into: int, out: int
) -> FloatArray:
    """Return a junction's numbers: one a connection, or one an outlet behind a single inlet."""
    if not element.needed:
        return np.zeros(0)
    count = into + out if element.needed == ("R",) else out
    if count == out and into != 1:
        raise FlowError(f"{place} has {into} inlet_vessels; its type takes one")
    lists = [numbers(given, key, place) for key in element.needed]
    for key, value in zip(element.needed, lists, strict=True):
        if len(value) != count:
            raise FlowError(f"{place}: {key} has {len(value)} numbers; it needs {count}")
        check_sign(float(value.min()), key, place)
    return np.concatenate(lists)
