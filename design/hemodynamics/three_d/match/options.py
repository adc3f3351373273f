"""Data classes: options, rounds and result of adjusting vessel radii to wanted 3D flows."""

from __future__ import annotations

from dataclasses import dataclass, field

from design.errors import FlowError
from design.hemodynamics.three_d.effective import Effective
from design.hemodynamics.three_d.match.target import Target
from design.hemodynamics.three_d.mesh import MeshOptions
from design.hemodynamics.three_d.options import FlowOptions
from design.network import VesselNetwork
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class MatchOptions:
    """Options of adjusting vessel radii to wanted 3D flows.

    Attributes
    ----------
    tolerance : float
        Largest deviation of a wanted flow, of the inlet's flow.
    rounds : int
        Of meshing and solving, at most.
    vary : tuple of int, optional
        Vessels whose radii change. Without it those that end at outlets, where they decide the
        split (a tree of several outlets); else all.
    least_radius_mm : float, mm
        No radius that is changed goes below it: the smallest lumen that can be printed.
    most_change : float
        Factor by which a radius may grow or shrink at most.
    mesh : MeshOptions
    flow : FlowOptions
        Of order 2: its error (1e-4 in flows) is far below any tolerance here.
    """

    tolerance: float = 0.005
    rounds: int = 6
    vary: tuple[int, ...] | None = None
    least_radius_mm: float = 0.0
    most_change: float = 2.0
    mesh: MeshOptions = field(default_factory=MeshOptions)
    flow: FlowOptions = field(default_factory=lambda: FlowOptions(order=2))

    def __post_init__(self) -> None:
        if not 1e-4 <= self.tolerance <= 0.5:
            raise FlowError(
                f"tolerance {self.tolerance:g} of the inlet's flow; give 0.0001 to 0.5 (3D itself "
                "is right to about 0.0001)"
            )
        if self.rounds < 1 or not 1.0 < self.most_change <= 10.0 or self.least_radius_mm < 0.0:
            raise FlowError(
                f"rounds {self.rounds}, most_change {self.most_change:g}, least_radius_mm "
                f"{self.least_radius_mm:g}: give 1 or more, above 1 up to 10, and 0 or more"
            )


@dataclass(frozen=True)
class Round:
    """What one mesh and its solution said.

    Attributes
    ----------
    worst : float
        Largest deviation of a wanted flow, of the inlet's flow.
    vessel : int
        Where.
    scale : (v,) float64
        Radii over the design's.
    pressure_drop_pa : float, Pa
        Largest difference between ports.
    elements : int
    """

    worst: float
    vessel: int
    scale: FloatArray
    pressure_drop_pa: float
    elements: int


@dataclass(frozen=True)
class MatchedNetwork:
    """The network of the best round.

    Attributes
    ----------
    network : VesselNetwork
    target : Target
    history : tuple of Round
        The first is the design.
    best : int
        Round of ``network``.
    met : bool
        Whether the tolerance is met.
    bounded : tuple of int
        Vessels whose radius stands at its least or greatest.
    effective : Effective
        Of the best round.
    """

    network: VesselNetwork
    target: Target
    history: tuple[Round, ...]
    best: int
    met: bool
    bounded: tuple[int, ...]
    effective: Effective
