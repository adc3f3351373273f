"""Assemble the sparse equations of an svZeroDSolver case from groups of like blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import coo_array, csr_array

from design.hemodynamics.zero_d.svzerod.activation import Activation
from design.hemodynamics.zero_d.svzerod.terms import COUPLED, LOSS, STORED_LOSS, TermGroup, Timed
from kernels.arrays import FloatArray, IntArray

Places = tuple[IntArray, IntArray, FloatArray]


@dataclass(frozen=True)
class Group:
    """Blocks of one kind with the same numbers of inlets and outlets.

    Attributes
    ----------
    values : (m, q) float64
    tables : (m,) int64
    variables : (m, k) int64
        Pressure and flow of each connection, then the blocks' own.
    equations : (m, r) int64
    inlets, ports : int
        Connections that lead in, and all.
    activations : tuple of Activation
        Of chambers, (m,); empty for other kinds.
    """

    values: FloatArray
    tables: IntArray
    variables: IntArray
    equations: IntArray
    inlets: int
    ports: int
    activations: tuple[Activation, ...] = ()


@dataclass(frozen=True)
class LumpedSystem:
    """E ẏ + F y + c(t) + terms = 0.

    Attributes
    ----------
    e, f : csr_array, (n, n)
    constant : (n,) float64
    drive : csr_array, (n, tables)
        Times the tables' values, the part of c that changes.
    terms : tuple of TermGroup
        What is nonlinear, or linear with coefficients that change.
    """

    e: csr_array
    f: csr_array
    constant: FloatArray
    drive: csr_array
    terms: tuple[TermGroup, ...]


@dataclass
class Stamps:
    """Collector of equations; rows and columns are those of the group at hand.

    Attributes
    ----------
    size, tables : int
        Number of variables and of tables.
    steady : bool
        Whether the equations of the steady start are asked for.
    state, rates : (n,) float64
        At the begin.
    sampled : (tables,) float64
        At the begin.
    places : mapping of str to int
        Variables by name.
    """

    size: int
    tables: int
    steady: bool
    state: FloatArray
    rates: FloatArray
    sampled: FloatArray
    places: Mapping[str, int] = field(default_factory=dict)
    group: Group | None = None
    _e: list[Places] = field(default_factory=list)
    _f: list[Places] = field(default_factory=list)
    _drive: list[Places] = field(default_factory=list)
    _constant: list[tuple[IntArray, FloatArray]] = field(default_factory=list)
    _terms: list[TermGroup] = field(default_factory=list)

    @property
    def _here(self) -> Group:
        assert self.group is not None
        return self.group

    @property
    def start(self) -> tuple[FloatArray, FloatArray]:
        """Values and rates of the group's variables at the begin, (m, k) each."""
        return self.state[self._here.variables], self.rates[self._here.variables]

    @property
    def start_drive(self) -> FloatArray:
        """Values of the group's tables at the begin, (m,)."""
        return self.sampled[self._here.tables]

    def e(self, row: int, entries: Mapping[int, FloatArray | float]) -> None:
        """Add coefficients of rates to an equation, by variable."""
        self._put(self._e, row, entries)

    def f(self, row: int, entries: Mapping[int, FloatArray | float]) -> None:
        """Add coefficients of values to an equation, by variable."""
        self._put(self._f, row, entries)

    def c(self, row: int, value: FloatArray) -> None:
        """Add a constant to an equation."""
        self._constant.append((self._here.equations[:, row], value))

    def drive(self, row: int, factor: FloatArray | float) -> None:
        """Add the group's tables, times a factor, to an equation."""
        rows, tables = self._here.equations[:, row], self._here.tables
        self._drive.append((rows, tables, np.broadcast_to(factor, rows.shape)))

    def losses(self, row: int, flow: int, factor: FloatArray) -> None:
        """Add -factor |Q| Q to an equation, where the factor isn't 0."""
        self._loss(LOSS, row, flow, factor)

    def stored_losses(self, row: int, flow: int, factor: FloatArray) -> None:
        """Add 2 factor |Q| Q̇ to an equation, where the factor isn't 0."""
        self._loss(STORED_LOSS, row, flow, factor)

    def _loss(self, kind: int, row: int, flow: int, factor: FloatArray) -> None:
        on = factor != 0.0
        if on.any():
            here = self._here
            rows, flows = here.equations[on, row, None], here.variables[on, flow, None]
            self._terms.append(TermGroup(kind, rows, flows, ((0, 0),), factor[on, None]))

    def add(
        self,
        kind: int,
        rows: Sequence[int],
        variables: Sequence[int],
        slopes: Sequence[tuple[int, int]],
        constants: Sequence[FloatArray] | FloatArray = (),
        timed: Timed | None = None,
    ) -> None:
        """Add a term of each block: its equations, variables and derivatives (`TermGroup`)."""
        here = self._here
        own = here.variables[:, list(variables)]
        self._append(kind, rows, own, slopes, constants, timed)

    def add_coupled(self, row: int, variable: str, factor: FloatArray) -> None:
        """Add -factor times a variable of another block to an equation."""
        count = len(self._here.equations)
        other = np.full((count, 1), self.places[variable])
        self._append(COUPLED, (row,), other, (), (factor,), None)

    def _append(
        self,
        kind: int,
        rows: Sequence[int],
        variables: IntArray,
        slopes: Sequence[tuple[int, int]],
        constants: Sequence[FloatArray] | FloatArray,
        timed: Timed | None,
    ) -> None:
        equations = self._here.equations[:, list(rows)]
        given = np.array(constants, dtype=np.float64).reshape(len(constants), len(equations)).T
        self._terms.append(TermGroup(kind, equations, variables, tuple(slopes), given, timed))

    def system(self) -> LumpedSystem:
        """Return what was collected."""
        constant = np.zeros(self.size)
        for rows, values in self._constant:
            np.add.at(constant, rows, values)
        return LumpedSystem(
            _matrix(self._e, self.size, self.size),
            _matrix(self._f, self.size, self.size),
            constant,
            _matrix(self._drive, self.size, self.tables),
            tuple(self._terms),
        )

    def _put(self, to: list[Places], row: int, entries: Mapping[int, FloatArray | float]) -> None:
        rows, variables = self._here.equations[:, row], self._here.variables
        for column, value in entries.items():
            to.append((rows, variables[:, column], np.broadcast_to(value, rows.shape)))


def _matrix(places: list[Places], rows: int, columns: int) -> csr_array:
    if not places:
        return csr_array((rows, columns))
    row, column, value = (np.concatenate(part) for part in zip(*places, strict=True))
    keep = value != 0.0
    return csr_array(coo_array((value[keep], (row[keep], column[keep])), shape=(rows, columns)))
