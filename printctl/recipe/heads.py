"""Recipe section on print heads: ink, syringe, needle and assigned vessels of each."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from printctl.recipe.marks import InkName, NeedleName, SyringeName
from printctl.recipe.parts import Part

Kind = Literal["artery", "vein", "lymph", "connection", "channel"]


class HeadPart(Part):
    """One head, in the order of the printer's profile."""

    syringe: SyringeName = "hamilton_1ml"
    ink: InkName = "collagen_fresh"
    needle: NeedleName | None = Field(default=None, description="toolpath.needle where not given.")
    kinds: tuple[Kind, ...] = Field(
        default=(), description="Vessels that it writes into a bath, by kind."
    )
    trees: tuple[Annotated[int, Field(ge=0)], ...] = Field(
        default=(), description="Or by the number of their tree, which counts before the kind."
    )

    @property
    def writes_the_rest(self) -> bool:
        """Whether it writes what no other head names."""
        return not (self.kinds or self.trees)


def check_heads(heads: tuple[HeadPart, ...]) -> None:
    """Refuse heads that claim the same vessels, or two that write the rest.

    Raises
    ------
    ValueError
        Naming what two heads claim.
    """
    for name in ("kinds", "trees"):
        claimed = [one for head in heads for one in getattr(head, name)]
        twice = {one for one in claimed if claimed.count(one) > 1}
        if twice:
            raise ValueError(f"heads: {name} {sorted(map(str, twice))[0]} is given to two of them")
    if sum(head.writes_the_rest for head in heads) > 1 and any(
        not head.writes_the_rest for head in heads
    ):
        raise ValueError("heads: two name neither kinds nor trees; only one can write the rest")
