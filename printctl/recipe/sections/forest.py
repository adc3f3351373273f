"""Recipe section on a forest: several networks of trees in one tissue that don't touch."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from design.units import LengthUnit
from printctl.recipe.parts import Part, Point, value_given
from printctl.recipe.sections.growth import (
    ConnectionPart,
    FileName,
    Growth,
    Perfusion,
    SmallestDiameter,
    Terminals,
    check_trunk,
    check_unit,
)

Join = Literal["none", "loops", "mixing"]


class TreePart(Part):
    """One tree; what isn't given is as for the whole forest."""

    kind: Literal["artery", "vein", "lymph"]
    terminals: Terminals | None = None
    pressure_drop_mmhg: Annotated[float, Field(ge=1e-6, le=1000)] | None = None
    perfusion_ml_min_per_ml: Perfusion | None = None
    smallest_diameter_mm: SmallestDiameter | None = None
    root_mm: Point | None = Field(
        default=None, description="As far from the other roots as the surface allows by default."
    )
    root_direction: Point | None = None
    trunk: FileName | None = Field(
        default=None, description="CSV, SWC, JSON or npz of vessels from which growth goes on."
    )
    trunk_unit: LengthUnit | None = Field(default=None, description="Of a CSV or SWC file.")

    @model_validator(mode="after")
    def _keys_fit(self) -> TreePart:
        check_trunk(self.trunk, self.trunk_unit, self.root_mm or self.root_direction)
        return self


class GrownTrees(Part):
    """Trees that make one network: joined at their terminals, or alone."""

    trees: Annotated[tuple[TreePart, ...], Field(min_length=1, max_length=100)]
    join: Join | None = Field(
        default=None,
        description="loops: each arterial terminal to a venous one; mixing: one terminal of every "
        "tree at a node; none. Arteries and veins alone make loops, a single tree none.",
    )

    @property
    def how(self) -> Join:
        """How terminals are joined, said or implied."""
        if self.join is not None:
            return self.join
        return "none" if len(self.trees) == 1 else "loops"

    @model_validator(mode="after")
    def _can_be_joined(self) -> GrownTrees:
        kinds = [tree.kind for tree in self.trees]
        named = ", ".join(kinds)
        if self.join is None and len(kinds) > 1 and set(kinds) != {"artery", "vein"}:
            raise ValueError(f"trees are {named}; say join: mixing or none, or loops of two kinds")
        if self.how == "loops" and set(kinds) != {"artery", "vein"}:
            raise ValueError(
                f"loops join arteries to veins, and the trees are {named}; give lymph a network "
                "of its own, or join: mixing"
            )
        if self.how == "mixing" and (
            len(kinds) < 3 or "artery" not in kinds or set(kinds) == {"artery"}
        ):
            raise ValueError(
                f"mixing takes three trees or more, some that bring and some that drain; the trees "
                f"are {named}"
            )
        return self

    @property
    def fed(self) -> bool:
        """Whether all flow into it comes through arteries."""
        kinds = {tree.kind for tree in self.trees}
        return kinds == {"artery"} or self.how != "none"


class GivenVessels(Part):
    """Vessels that are there already and stay; what grows keeps clear of them."""

    network: FileName
    unit: LengthUnit | None = Field(
        default=None, description="Of the coordinates of a .csv or .vtp; other files say it."
    )

    @model_validator(mode="after")
    def _unit_is_known(self) -> GivenVessels:
        check_unit(self.network, self.unit)
        return self


def _member(value: Any) -> str:
    return "network" if value_given(value, "network") is not None else "trees"


MemberPart = Annotated[
    Annotated[GrownTrees, Tag("trees")] | Annotated[GivenVessels, Tag("network")],
    Discriminator(_member),
]


class Forest(Growth):
    """Several networks of trees that grow in turn and don't touch, each joined in itself."""

    grow: Literal["forest"]
    networks: Annotated[tuple[MemberPart, ...], Field(min_length=1, max_length=100)]
    territories: Literal["by_network", "divided", "whole"] = Field(
        default="by_network",
        description="What trees of one kind divide the tissue among: those of a network (unless it "
        "mixes), all of them, or none: each has the whole.",
    )
    connections: ConnectionPart = ConnectionPart()

    @property
    def grown(self) -> tuple[GrownTrees, ...]:
        """Networks that grow, in their order."""
        return tuple(one for one in self.networks if isinstance(one, GrownTrees))

    @property
    def given(self) -> GivenVessels | None:
        """What is there already."""
        return next((one for one in self.networks if isinstance(one, GivenVessels)), None)

    @property
    def trees(self) -> tuple[TreePart, ...]:
        """All trees, numbered as in flow.csv."""
        return tuple(tree for one in self.grown for tree in one.trees)

    def files(self) -> list[str]:
        """Names of the trunks' files and of what is given."""
        trunks = [tree.trunk for tree in self.trees if tree.trunk is not None]
        return [*trunks, *([] if self.given is None else [self.given.network])]

    def terminals_of(self, tree: TreePart) -> int:
        """A tree's terminals; 0 where nothing says them."""
        return tree.terminals or self.terminals or 0

    def _counted_by(self) -> str | None:
        return "trees" if all(self.terminals_of(tree) for tree in self.trees) else None

    @model_validator(mode="after")
    def _keys_fit(self) -> Forest:
        if self.root_mm or self.root_direction:
            raise ValueError("each tree of a forest has its root_mm; give it there")
        if not self.grown:
            raise ValueError("a forest grows at least one tree; give a network with trees")
        if len(self.networks) - len(self.grown) > 1:
            raise ValueError("networks name two files; join them in one file")
        for number, one in enumerate(self.networks):
            if isinstance(one, GrownTrees):
                self._sides_fit(number, one)
        return self

    def _sides_fit(self, number: int, one: GrownTrees) -> None:
        """Refuse a join of sides whose terminals differ in number."""
        counts = [self.terminals_of(tree) for tree in one.trees]
        if one.how == "mixing" and len(set(counts)) > 1:
            raise ValueError(
                f"networks.{number} mixes trees of {', '.join(map(str, counts))} terminals; give "
                "all the same number"
            )
        if one.how == "loops":
            kinds = [tree.kind for tree in one.trees]
            brought, drained = (
                sum(n for n, kind in zip(counts, kinds, strict=True) if kind == side)
                for side in ("artery", "vein")
            )
            if brought != drained:
                raise ValueError(
                    f"networks.{number} joins {brought} arterial terminals to {drained} venous "
                    "ones; give both sides the same number"
                )
