"""Options of tree growth: terminals, flow, cost exponents, root, clearances, stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from math import cos, pi, radians, sqrt
from typing import Any, Literal, NamedTuple

import numpy as np

from design.errors import GrowthError
from design.units import BLOOD_MPA_S, PA_PER_MMHG
from design.vasculature.penalty import DepthPenalty, PenaltyFunction
from kernels import jit
from kernels.arrays import FloatArray

Angles = tuple[float, float]


class Law(NamedTuple):
    """The constants of the cost, as compiled code takes them.

    Attributes
    ----------
    k : float, Pa·s
        8 μ / π.
    gamma, lam, u : float
        Murray exponent, and exponents of radius and length in the cost.
    haematocrit : float
        Of Pries' law; below 0 for a Newtonian fluid.
    """

    k: float
    gamma: float
    lam: float
    u: float
    haematocrit: float = -1.0


@dataclass(frozen=True)
class GrowthStage:
    """A part of growth with parameters of its own; what isn't given is as in `GrowthOptions`.

    Attributes
    ----------
    terminals : int
        Reached when the stage ends.
    """

    terminals: int
    clearance_mm: float | None = None
    clearance_ratio: float | None = None
    length_to_radius: float | None = None
    follow_demand: bool | None = None
    branch_angle_degrees: Angles | None = None
    turn_angle_degrees: Angles | None = None
    flow_ratio: float | None = None
    penalty: DepthPenalty | PenaltyFunction | None = None


@dataclass(frozen=True)
class GrowthOptions:
    """Options of growing a tree.

    Attributes
    ----------
    terminals : int
        How many; with given points, as many as these.
    seed : int
        Of the sampled points; same seed and tissue, same tree.
    murray_exponent : float
        γ, 2 to 3.5.
    length_exponent, radius_exponent : float
        u and λ of the cost Σ ℓᵘ r^λ; 1 and 2 make it the volume.
    viscosity_pa_s : float
        μ; with a viscosity law, in wide vessels.
    viscosity_law : "newtonian" or "pries_1994"
        The second makes μ follow the diameter (`design.vasculature.viscosity`).
    haematocrit : float
        Of that law.
    pressure_drop_pa : float
        From the root's inlet to every terminal's outlet; sets the scale of all radii unless
        ``smallest_radius_mm`` does.
    perfusion_ml_min_per_ml : float
        Flow per tissue volume, the mean over the tissue.
    terminal_flow : "equal" or "demand"
        How the flow is shared: equally, or as the demand of each terminal's territory (the part
        of the tissue nearer to it than to any other terminal).
    follow_demand : bool
        With equal flows, sample more terminals where the tissue's demand is higher.
    terminal_points_mm : (n, 3), optional
        Terminals, in place of sampled ones.
    terminal_flows : (n,), optional
        Their flows, in any unit; the total is set by the perfusion. Equal by default.
    root_point_mm, root_direction : (float, float, float), optional
        Where the root enters, and which way. By default it enters squarely, inside a face that
        has room for it (`growth.mouths`), on top where there is one.
    root_at_top : bool
        At the surface vertex of largest z instead, along the inward normal there, be it on an edge:
        the root of published cases. Its walls aren't checked.
    root_candidates : int
        0, or of how many places spread over the surface the cheapest is searched for.
    smallest_radius_mm : float, optional
        Fixes the smallest radius of the finished tree; the pressure drop follows.
    terminal_spread : float, optional
        With ``smallest_radius_mm``: how much wider than the smallest terminal the terminals may be
        on average (in the mean of order γ). Candidates that would make a thinner one are refused;
        the root's radius is about spread x smallest x terminals^(1/γ). Several are tried by
        default.
    clearance_mm, clearance_ratio : float
        Between vessels, the larger of ``clearance_mm`` and ``clearance_ratio`` times the thinner
        radius; ``clearance_mm`` also between vessels and the tissue's surface.
    length_to_radius : float
        Shortest segment over its radius.
    branch_angle_degrees : (float, float)
        Least and greatest angle between the two children of a joint.
    turn_angle_degrees : (float, float)
        Least and greatest angle of each child against its parent's way on.
    flow_ratio : float
        Least flow of a child over its sibling's, 0 to 0.5.
    penalty : DepthPenalty or function of (n, 3) to (n,), optional
        Factor on the whole cost of a trial by its branch point's place.
    stages : tuple of GrowthStage
        Growth in turn to so many terminals with parameters of their own, the last to all. A
        stage's limits hold for what it grows; the finished tree is audited by the mildest of all.
    """

    terminals: int = 200
    seed: int = 1
    murray_exponent: float = 3.0
    length_exponent: float = 1.0
    radius_exponent: float = 2.0
    viscosity_pa_s: float = BLOOD_MPA_S * 1e-3
    viscosity_law: Literal["newtonian", "pries_1994"] = "newtonian"
    haematocrit: float = 0.45
    pressure_drop_pa: float = 40.0 * PA_PER_MMHG
    perfusion_ml_min_per_ml: float = 0.8
    terminal_flow: Literal["equal", "demand"] = "equal"
    follow_demand: bool = True
    terminal_points_mm: Sequence[Sequence[float]] | FloatArray | None = None
    terminal_flows: Sequence[float] | FloatArray | None = None
    root_point_mm: tuple[float, float, float] | None = None
    root_direction: tuple[float, float, float] | None = None
    root_at_top: bool = False
    root_candidates: int = 0
    smallest_radius_mm: float | None = None
    terminal_spread: float | None = None
    clearance_mm: float = 0.0
    clearance_ratio: float = 0.1
    length_to_radius: float = 1.0
    branch_angle_degrees: Angles = (0.0, 180.0)
    turn_angle_degrees: Angles = (0.0, 180.0)
    flow_ratio: float = 0.0
    penalty: DepthPenalty | PenaltyFunction | None = None
    stages: tuple[GrowthStage, ...] = ()

    def __post_init__(self) -> None:
        self._take_points()
        for name, low, high in _LIMITS:
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise GrowthError(f"{name} is {value:g}; give a value from {low:g} to {high:g}")
        for name in ("root_point_mm", "root_direction"):
            value = getattr(self, name)
            if value is not None and not (len(value) == 3 and np.isfinite(value).all()):
                raise GrowthError(f"{name} is {value}; give three finite numbers")
        if self.root_direction is not None and not np.any(self.root_direction):
            raise GrowthError("root_direction is (0, 0, 0); give a direction")
        if self.root_candidates and self.root_point_mm is not None:
            raise GrowthError("give either root_point_mm or root_candidates, and not both")
        if self.root_at_top and (
            self.root_candidates or self.root_point_mm or self.root_direction is not None
        ):
            raise GrowthError(
                "root_at_top says where the root enters; give it without root_point_mm, "
                "root_direction and root_candidates"
            )
        for name in ("branch_angle_degrees", "turn_angle_degrees"):
            check_angles(name, getattr(self, name))
        for name, known in _CHOICES:
            if getattr(self, name) not in known:
                raise GrowthError(f"{name} is {getattr(self, name)!r}; choose one of {known}")
        self._check_stages()

    def _take_points(self) -> None:
        """Keep given terminals as tuples, so that options compare, and count them."""
        points, flows = self.terminal_points_mm, self.terminal_flows
        if points is None:
            if flows is not None:
                raise GrowthError("terminal_flows needs terminal_points_mm; give both")
            return
        at = np.asarray(points, dtype=np.float64)
        if at.ndim != 2 or at.shape[1] != 3 or not len(at) or not np.isfinite(at).all():
            raise GrowthError(
                f"terminal_points_mm is of shape {at.shape}; give at least one point of three "
                "finite numbers each"
            )
        if len(np.unique(at, axis=0)) < len(at):
            raise GrowthError("terminal_points_mm names a point twice; give each once")
        object.__setattr__(self, "terminal_points_mm", tuple(map(tuple, at.tolist())))
        object.__setattr__(self, "terminals", len(at))
        if flows is None:
            return
        share = np.asarray(flows, dtype=np.float64)
        if share.shape != (len(at),) or not (np.isfinite(share) & (share > 0)).all():
            raise GrowthError(
                f"terminal_flows has shape {share.shape} for {len(at)} points; give a flow above 0 "
                "for each"
            )
        if self.terminal_flow == "demand":
            raise GrowthError("give either terminal_flows or terminal_flow: demand, and not both")
        object.__setattr__(self, "terminal_flows", tuple(share.tolist()))

    def _check_stages(self) -> None:
        if not self.stages:
            return
        reached = [stage.terminals for stage in self.stages]
        if (np.diff([0, *reached]) <= 0).any() or reached[-1] != self.terminals:
            raise GrowthError(
                f"stages reach {reached} of {self.terminals} terminals; let them ascend to all"
            )
        for stage in self.stages:
            self.at_stage(stage)

    @property
    def law(self) -> Law:
        """The cost's constants."""
        return Law(
            8.0 * self.viscosity_pa_s / pi,
            self.murray_exponent,
            self.radius_exponent,
            self.length_exponent,
            self.law_haematocrit,
        )

    @property
    def law_haematocrit(self) -> float:
        """Of the viscosity law; -1 for a Newtonian fluid."""
        return -1.0 if self.viscosity_law == "newtonian" else self.haematocrit

    @property
    def limits(self) -> Limits:
        """The limits on joints, as compiled code takes them."""
        return joint_limits(self.branch_angle_degrees, self.turn_angle_degrees, self.flow_ratio)

    def at_stage(self, stage: GrowthStage) -> GrowthOptions:
        """The options in a stage."""
        own = {f.name: getattr(stage, f.name) for f in fields(stage) if f.name != "terminals"}
        return replace(self, stages=(), **{k: v for k, v in own.items() if v is not None})

    def mildest(self) -> GrowthOptions:
        """The options with the mildest limits of all stages."""
        if not self.stages:
            return self
        each = [self.at_stage(stage) for stage in self.stages]
        least: dict[str, Any] = {
            name: min(getattr(one, name) for one in each)
            for name in ("clearance_mm", "clearance_ratio", "length_to_radius", "flow_ratio")
        }
        for name in ("branch_angle_degrees", "turn_angle_degrees"):
            low, high = zip(*(getattr(one, name) for one in each), strict=True)
            least[name] = (min(low), max(high))
        return replace(self, **least)

    def flow_ul_s(self, volume_mm3: float) -> float:
        """Flow into the root for a tissue of ``volume_mm3``, µL/s."""
        return self.perfusion_ml_min_per_ml * volume_mm3 / 60.0


_LIMITS = (
    ("terminals", 1, 50_000_000),
    ("seed", 0, 2**63),
    ("murray_exponent", 2.0, 3.5),
    ("length_exponent", 0.25, 4.0),
    ("radius_exponent", 0.25, 4.0),
    ("viscosity_pa_s", 1e-5, 1e3),
    ("haematocrit", 0.0, 0.8),
    ("pressure_drop_pa", 1e-6, 1e9),
    ("perfusion_ml_min_per_ml", 1e-6, 1e4),
    ("root_candidates", 0, 10_000),
    ("smallest_radius_mm", 1e-4, 10.0),
    ("terminal_spread", 1.01, 10.0),
    ("clearance_mm", 0.0, 100.0),  # a template's tubes for two vessels take a multiple
    ("clearance_ratio", 0.0, 10.0),
    ("length_to_radius", 0.0, 100.0),
    ("flow_ratio", 0.0, 0.5),
)
_CHOICES = (
    ("viscosity_law", ("newtonian", "pries_1994")),
    ("terminal_flow", ("equal", "demand")),
)


class Limits(NamedTuple):
    """Limits on joints, as compiled code takes them; angles by their cosines.

    Attributes
    ----------
    on : bool
        Whether there are any.
    narrow, wide : float
        Cosines of the least and the greatest angle between two children.
    slight, sharp : float
        The same of each child against its parent's way on.
    share : float
        Least flow of a child over its sibling's, 0 to 1.
    """

    on: bool
    narrow: float
    wide: float
    slight: float
    sharp: float
    share: float


def check_angles(name: str, angles: tuple[float, float]) -> None:
    """Refuse what isn't a least and a greatest angle.

    Raises
    ------
    GrowthError
    """
    if len(angles) != 2 or not 0.0 <= angles[0] < angles[1] <= 180.0:
        raise GrowthError(
            f"{name} is {tuple(angles)}; give a least and a greatest angle from 0 to 180 degrees"
        )


def joint_limits(
    branch_degrees: tuple[float, float], turn_degrees: tuple[float, float], flow_ratio: float
) -> Limits:
    """Limits in a user's words as compiled code takes them."""
    free = (0.0, 180.0)
    on = tuple(branch_degrees) != free or tuple(turn_degrees) != free or flow_ratio > 0.0
    narrow, wide, slight, sharp = (cos(radians(x)) for x in (*branch_degrees, *turn_degrees))
    return Limits(on, narrow, wide, slight, sharp, flow_ratio)


COSINE_TOLERANCE = 1e-12
"""Rounding of a cosine or a share of the flow."""


@jit
def _cosine(at: Any, a: Any, b: Any) -> float:
    """Cosine of the angle at one point between the ways to two others; 1 where there is none."""
    ux, uy, uz = a[0] - at[0], a[1] - at[1], a[2] - at[2]
    vx, vy, vz = b[0] - at[0], b[1] - at[1], b[2] - at[2]
    size = sqrt((ux * ux + uy * uy + uz * uz) * (vx * vx + vy * vy + vz * vz))
    if not size > 0.0:
        return 1.0
    return (ux * vx + uy * vy + uz * vz) / size


@jit
def angles_fit(limits: Limits, begin: Any, at: Any, one: Any, two: Any) -> bool:
    """Whether a joint at ``at`` keeps the limits on angles.

    Parameters
    ----------
    begin : (float, float, float), mm
        Where the parent comes from.
    one, two : (float, float, float), mm
        Ends of the children.
    """
    c = _cosine(at, one, two)
    if c > limits.narrow + COSINE_TOLERANCE or c < limits.wide - COSINE_TOLERANCE:
        return False
    for end in (one, two):
        c = -_cosine(at, begin, end)
        if c > limits.slight + COSINE_TOLERANCE or c < limits.sharp - COSINE_TOLERANCE:
            return False
    return True


@jit
def shares_fit(limits: Limits, one: float, two: float) -> bool:
    """Whether two children's flows are near enough to each other."""
    return bool(min(one, two) >= (limits.share - COSINE_TOLERANCE) * max(one, two))
