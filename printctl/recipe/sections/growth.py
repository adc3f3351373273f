"""Recipe sections on vessel networks: shipped, from a file, grown, and their connections."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from design.units import BLOOD_MPA_S, LengthUnit
from printctl.recipe.parts import FILE, LatticeShape, NetworkSection, Part, Point
from printctl.recipe.sections.anatomy import AnatomyPart

_Weight = Annotated[float, Field(ge=0, le=1000)]


class LatticeNetwork(NetworkSection, LatticeShape):
    """Channels of a regular lattice clipped to the tissue, with one inlet and one outlet."""


class ConnectionPart(Part):
    """Bounds of the curves between terminals, and what a candidate is weighed by."""

    bend_to_radius: Annotated[float, Field(ge=1, le=100)] = Field(
        default=2.0, description="Least bend radius over the lumen's radius."
    )
    kink_degrees: Annotated[float, Field(ge=1, le=85)] = Field(
        default=75.0, description="Largest angle between a terminal and its connection."
    )
    radius_ratio: Annotated[float, Field(ge=0.1, le=10)] = Field(
        default=0.75,
        description="Of a typical connection over the median terminal's; the smallest diameter "
        "goes before.",
    )
    most_pruned_percent: Annotated[float, Field(ge=0, le=50)] = Field(
        default=1.0, description="Terminals that may be taken away where nothing joins them."
    )
    length_weight: _Weight = 1.0
    tortuosity_weight: _Weight = 0.5
    clearance_weight: _Weight = 0.5
    volume_weight: _Weight = 0.5


FileName = Annotated[
    str,
    Field(min_length=1, description="Path, relative to the recipe.", json_schema_extra=FILE),
]
Terminals = Annotated[int, Field(ge=1, le=50_000_000)]
Clearance = Annotated[float, Field(ge=0, le=10)]
Candidates = Annotated[int, Field(ge=1, le=10_000)]
Degrees = Annotated[float, Field(ge=0, le=180)]
Angles = Annotated[tuple[Degrees, Degrees], Field(description="Least and greatest, degrees.")]
LengthToRadius = Annotated[
    float, Field(ge=0, le=100, description="Shortest segment over its radius.")
]
Perfusion = Annotated[float, Field(ge=1e-6, le=100)]
SmallestDiameter = Annotated[float, Field(ge=2e-4, le=10)]
Exponent = Annotated[float, Field(ge=0.25, le=4)]
FlowRatio = Annotated[
    float, Field(ge=0, le=0.5, description="Least flow of a child over its sibling's.")
]


def check_unit(network: str, unit: LengthUnit | None) -> None:
    """Raise `ValueError` for a file that is no network's, or whose unit is missing or needless."""
    kind = network.rsplit(".", 1)[-1].lower()
    if kind not in ("csv", "vtp", "swc", "json", "npz", "txt"):
        raise ValueError(
            f"network {network} isn't a .csv, .vtp, .swc, .json, .npz or .txt; convert it"
        )
    if kind not in ("swc", "txt") and (kind in ("csv", "vtp")) != (unit is not None):
        wanted = "give unit" if unit is None else "remove unit"
        raise ValueError(
            f"network {network}: .csv, .vtp, .swc and .txt alone are in a unit of the user's; "
            f"{wanted}"
        )


def check_root(root: str | None, given: object) -> None:
    """Raise `ValueError` where a root that is found (``root``) is ``given``, too."""
    if root is not None and given:
        raise ValueError(
            f"root: {root} finds root and direction itself; give it without root_mm, "
            "root_direction and trunk"
        )


def check_trunk(trunk: str | None, unit: LengthUnit | None, root: object) -> None:
    """Raise `ValueError` where a trunk has a root besides, or its file and unit don't fit."""
    if trunk is None:
        if unit is not None:
            raise ValueError("trunk_unit is a trunk's; give trunk, or remove it")
        return
    if root:
        raise ValueError("a trunk begins where it does; give it without root_mm")
    suffix = trunk.rsplit(".", 1)[-1].lower()
    if suffix not in ("csv", "swc", "json", "npz"):
        raise ValueError(f"trunk {trunk} isn't a .csv, .swc, .json or .npz; convert it")
    if suffix != "swc" and (suffix == "csv") != (unit is not None):
        wanted = "give trunk_unit" if suffix == "csv" else "remove trunk_unit"
        raise ValueError(f"trunk {trunk}: CSV and SWC alone are in a unit of the user's; {wanted}")


class NamedNetwork(NetworkSection):
    """A network shipped with the product."""

    design: Literal["planar_four_vessel"]


class GivenNetwork(NetworkSection):
    """A network from a file of any format that is read."""

    network: Annotated[
        FileName,
        Field(
            description=".csv, .vtp, .swc, .json, .npz, .txt. Columns of a .csv: x, y, z, radius, "
            "parent (a point per row, parent: its row from 0, or -1), or those of network.csv."
        ),
    ]
    unit: LengthUnit | None = Field(
        default=None,
        description="Of a .csv or .vtp; of an .swc that isn't in um, and a .txt that isn't in cm.",
    )
    clearance_mm: float = Field(default=0.0, ge=0, le=10, description="Least wall between vessels.")
    overlaps: Literal["refuse", "tell"] = Field(
        default="refuse",
        description="What to do where vessels are nearer than that without meeting; tell: go on.",
    )

    @model_validator(mode="after")
    def _unit_is_known(self) -> GivenNetwork:
        check_unit(self.network, self.unit)
        return self

    def files(self) -> list[str]:
        """The network's."""
        return [self.network]


class PenaltyPart(Part):
    """Factor on the cost of a branch point against its depth below the surface."""

    depth_mm: Annotated[
        tuple[Annotated[float, Field(ge=0, le=1000)], ...], Field(min_length=1, max_length=1000)
    ]
    factor: tuple[Annotated[float, Field(gt=0, le=1e6)], ...]

    @model_validator(mode="after")
    def _is_a_table(self) -> PenaltyPart:
        if len(self.depth_mm) != len(self.factor):
            raise ValueError(
                f"{len(self.depth_mm)} depths but {len(self.factor)} factors; give one for each"
            )
        if any(two <= one for one, two in pairwise(self.depth_mm)):
            raise ValueError("depth_mm doesn't ascend; sort the table by depth")
        return self


class StagePart(Part):
    """A part of growth with parameters of its own; what isn't given is as for the whole."""

    terminals: Terminals = Field(description="Reached when the stage ends.")
    clearance_mm: Clearance | None = None
    length_to_radius: LengthToRadius | None = None
    follow_demand: bool | None = None
    branch_angle_degrees: Angles | None = None
    turn_angle_degrees: Angles | None = None
    flow_ratio: FlowRatio | None = None
    penalty: PenaltyPart | None = None


class InletPart(Part):
    """Where a tree enters."""

    at_mm: Point
    direction: Point | None = Field(
        default=None, description="Into the tissue; the surface's normal there by default."
    )


class Growth(NetworkSection):
    """What every grown tree is told."""

    terminals: Terminals | None = Field(
        default=None, description="Of each tree; given points and stages say it themselves."
    )
    murray_exponent: Annotated[float, Field(ge=2, le=3.5)] = 3.0
    length_exponent: Exponent = Field(
        default=1.0, description="u of the cost, the sum of length^u radius^λ."
    )
    radius_exponent: Exponent = Field(
        default=2.0, description="λ of the cost; with u = 1 and λ = 2 it is the volume."
    )
    viscosity_mpa_s: Annotated[float, Field(ge=0.01, le=1000)] = Field(
        default=BLOOD_MPA_S, description="With a viscosity law, in wide vessels."
    )
    viscosity_law: Literal["newtonian", "pries_1994"] = "newtonian"
    haematocrit: Annotated[float, Field(ge=0, le=0.8)] = Field(
        default=0.45, description="Of the viscosity law pries_1994."
    )
    pressure_drop_mmhg: Annotated[float, Field(ge=1e-6, le=1000)] = 40.0
    perfusion_ml_min_per_ml: Perfusion = 0.8
    smallest_diameter_mm: SmallestDiameter | None = Field(
        default=None, description="Fixes the smallest lumen; the pressure drop follows."
    )
    clearance_mm: Clearance = 0.1
    clearance_ratio: Annotated[float, Field(ge=0, le=10)] = Field(
        default=0.1, description="Clearance at least, over the thinner vessel's radius."
    )
    length_to_radius: LengthToRadius = 1.0
    branch_angle_degrees: Angles = Field(default=(0, 180), description="Between two children.")
    turn_angle_degrees: Angles = Field(
        default=(0, 180), description="Of each child against its parent's way on."
    )
    flow_ratio: FlowRatio = 0.0
    penalty: PenaltyPart | None = None
    follow_demand: bool = Field(
        default=True, description="More terminals where the tissue's demand is higher."
    )
    root_mm: Point | None = None
    root_direction: Point | None = None

    @model_validator(mode="before")
    @classmethod
    def _without_polish(cls, data: Any) -> Any:
        """Read recipes and runs that were written with ``polish: false``, its former default."""
        if isinstance(data, dict) and data.get("polish") is False:
            return {key: value for key, value in data.items() if key != "polish"}
        return data

    @model_validator(mode="after")
    def _growth_is_possible(self) -> Growth:
        for name in ("branch_angle_degrees", "turn_angle_degrees"):
            low, high = getattr(self, name)
            if not low < high:
                raise ValueError(f"{name} [{low:g}, {high:g}] doesn't ascend; give least, greatest")
        if self._counted_by() is None:
            raise ValueError("how many terminals isn't said; add terminals")
        return self

    def _counted_by(self) -> str | None:
        """The key that says how many terminals there are."""
        return None if self.terminals is None else "terminals"


class GrownNetwork(Growth):
    """A tree grown by constrained constructive optimisation."""

    grow: Literal["tree"]
    printable: bool = Field(
        default=False,
        description="Keep to what needle and method can print, and say how far the tree grew.",
    )
    terminal_points: FileName | None = Field(
        default=None, description="CSV with x_mm, y_mm, z_mm and, if wanted, flow."
    )
    terminal_flow: Literal["equal", "demand"] = Field(
        default="equal", description="demand: by what each terminal's territory asks for."
    )
    root: Literal["search", "top"] | None = Field(
        default=None,
        description="search: where a small tree costs least; top: at the highest vertex along its "
        "normal, even on an edge, as in published cases.",
    )
    root_candidates: Candidates = 24
    inlets: (
        Literal["each_part"]
        | Annotated[tuple[InletPart, ...], Field(min_length=1, max_length=1000)]
        | None
    ) = Field(
        default=None,
        description="each_part: one for every separate part of the tissue, and more where vessels "
        "from one don't reach all of it; or a list of places.",
    )
    trunk: FileName | None = Field(
        default=None, description="CSV, SWC, JSON or npz of the artery from which growth goes on."
    )
    trunk_unit: LengthUnit | None = Field(default=None, description="Of a CSV or SWC file.")
    stages: tuple[StagePart, ...] = Field(default=(), max_length=100)
    anatomy: AnatomyPart | None = Field(
        default=None, description="Trunks, inlets and zones as an organ has them."
    )
    curves: bool = Field(
        default=False, description="Round bends and the joints of main lines, where there is room."
    )

    def files(self) -> list[str]:
        """The terminals' and the trunk's."""
        return [name for name in (self.terminal_points, self.trunk) if name is not None]

    def _counted_by(self) -> str | None:
        given = {
            "terminals": self.terminals is not None,
            "terminal_points": self.terminal_points is not None,
            "stages": bool(self.stages),
        }
        named = [key for key, is_there in given.items() if is_there]
        if len(named) > 1:
            raise ValueError(f"{' and '.join(named)} each say how many terminals; give one of them")
        return named[0] if named else None

    @model_validator(mode="after")
    def _keys_fit(self) -> GrownNetwork:
        for key in ("trunk", "stages", "terminal_points"):
            if self.printable and getattr(self, key):
                raise ValueError(f"printable doesn't go with {key} yet; give one of the two")
        if self.printable and self.root == "search":
            raise ValueError("printable doesn't go with root: search yet; give one of the two")
        others = ("printable", "trunk", "stages", "terminal_points", "root", "root_mm")
        for key in (*others, "inlets"):
            if self.anatomy is not None and getattr(self, key):
                raise ValueError(f"anatomy doesn't go with {key}; give one of the two")
        self._inlets_fit()
        self._curves_fit()
        check_root(self.root, self.root_mm or self.root_direction or self.trunk)
        check_trunk(self.trunk, self.trunk_unit, self.root_mm or self.root_direction)
        reached = [stage.terminals for stage in self.stages]
        if any(two <= one for one, two in pairwise(reached)):
            raise ValueError(f"stages reach {reached} terminals; let them ascend")
        return self

    def _curves_fit(self) -> None:
        if not self.curves:
            return
        if self.anatomy is not None:
            raise ValueError("the vessels of an anatomy are curved as it is; leave curves out")
        limits = ("smallest_diameter_mm", "length_to_radius", "branch_angle_degrees")
        for key in ("printable", "trunk", *limits, "turn_angle_degrees"):
            if getattr(self, key) != type(self).model_fields[key].default:
                raise ValueError(f"curves wouldn't keep to {key}; give one of the two")

    def _inlets_fit(self) -> None:
        if self.inlets is None:
            return
        for key in ("printable", "trunk", "stages", "terminal_points", "root"):
            if getattr(self, key):
                raise ValueError(f"inlets don't go with {key} yet; give one of the two")
        if self.inlets != "each_part" and (self.root_mm or self.root_direction):
            raise ValueError("inlets say where the trees enter; remove root_mm and root_direction")


class ClosedLoop(Growth):
    """An arterial and a venous tree that don't touch, their terminals joined by smooth curves."""

    grow: Literal["closed_loop"]
    root: Literal["search"] | None = Field(
        default=None, description="search: the artery's where a small tree costs least."
    )
    root_candidates: Candidates = 24
    vein_root_mm: Point | None = Field(
        default=None, description="As far from the artery's root as the surface allows by default."
    )
    vein_root_direction: Point | None = None
    connections: ConnectionPart = ConnectionPart()

    @model_validator(mode="after")
    def _root_is_given_once(self) -> ClosedLoop:
        check_root(self.root, self.root_mm or self.root_direction)
        return self
