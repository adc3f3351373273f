"""Recipe section on the vessel network, by kind: shipped, file, lattice, tree, loops, forest."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Discriminator, Tag

from printctl.recipe.forest import Forest
from printctl.recipe.growth import ClosedLoop, GivenNetwork, GrownNetwork, NamedNetwork
from printctl.recipe.lattice import LatticeNetwork
from printctl.recipe.parts import value_given


def _network_kind(value: Any) -> str:
    grown = value_given(value, "grow")
    if grown is not None:
        return f"grow: {grown}"
    return next(
        (key for key in ("design", "network", "lattice") if value_given(value, key) is not None),
        "none",
    )


NetworkPart = Annotated[
    Annotated[NamedNetwork, Tag("design")]
    | Annotated[GivenNetwork, Tag("network")]
    | Annotated[LatticeNetwork, Tag("lattice")]
    | Annotated[GrownNetwork, Tag("grow: tree")]
    | Annotated[ClosedLoop, Tag("grow: closed_loop")]
    | Annotated[Forest, Tag("grow: forest")],
    Discriminator(_network_kind),
]
