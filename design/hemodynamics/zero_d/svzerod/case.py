"""Data classes of an svZeroDSolver input file's content: connected blocks and solver options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from design.hemodynamics.zero_d.svzerod.activation import Activation
from design.hemodynamics.zero_d.svzerod.tables import Tables
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class Block:
    """Element between connections, as the file names it.

    Attributes
    ----------
    name, kind : str
        ``kind`` is a key of `elements.ELEMENTS`.
    values : (q,) float64
        Its numbers, in the order of its element's parameters.
    table : int
        Number of its table; -1 for none.
    inlets, outlets : tuple of int
        Connections that lead in and out.
    written : bool
        Whether a table of vessels has it.
    activation : Activation or None
        Of a chamber.
    """

    name: str
    kind: str
    values: FloatArray
    table: int
    inlets: tuple[int, ...]
    outlets: tuple[int, ...]
    written: bool = False
    activation: Activation | None = None


@dataclass(frozen=True)
class SolverOptions:
    """What ``simulation_parameters`` says; attributes are named as its keys.

    Attributes
    ----------
    points : int
        Time points of a cycle, both ends counted.
    cycles : int
    cycle_error : float or None
        Largest change of mean flow and pressure from cycle to cycle; None to run ``cycles``.
    cardiac_period : float or None
    """

    points: int
    cycles: int
    absolute_tolerance: float = 1e-8
    maximum_nonlinear_iterations: int = 30
    steady_initial: bool = True
    rho_infty: float = 0.5
    cycle_error: float | None = None
    cardiac_period: float | None = None
    output_interval: int = 1
    output_all_cycles: bool = False
    output_mean_only: bool = False
    output_derivative: bool = False
    output_variable_based: bool = False


@dataclass(frozen=True)
class SvZeroDCase:
    """What a file says, in its own (consistent) units.

    Attributes
    ----------
    blocks : tuple of Block
        In svZeroDSolver's order: vessels, couplings, boundary conditions, junctions, heart, valves,
        chambers.
    vessels : int
        Number of vessels.
    connections : tuple of str
        ``first:second`` of each pair of blocks that meet.
    options : SolverOptions
    period : float
        Of a cycle.
    tables : Tables
    initial, initial_rates : mapping
        Values and rates of variables at the begin; those not named are 0.
    """

    blocks: tuple[Block, ...]
    vessels: int
    connections: tuple[str, ...]
    options: SolverOptions
    period: float
    tables: Tables
    initial: Mapping[str, float]
    initial_rates: Mapping[str, float]

    @cached_property
    def written(self) -> tuple[Block, ...]:
        """Vessels, and what else a table of vessels has."""
        return tuple(block for block in self.blocks if block.written)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what a table of vessels has."""
        return tuple(block.name for block in self.written)
