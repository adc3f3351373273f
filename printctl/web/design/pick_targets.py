"""Recipe fields that a click on the tissue surface can set."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from printctl.recipe.anatomy import INLETS
from printctl.web.design import form as forms

_DIGITS: Final = 3
"""Of a place, mm."""
_AT: Final = ("vasculature",)


@dataclass(frozen=True)
class PickTarget:
    """What a picked place is for.

    Attributes
    ----------
    name : str
        As the page calls it.
    path : tuple of str or int
        Field that is written.
    key : str or int or None
        Within it: an inlet's name or number; None where the field is the place itself.
    """

    name: str
    path: forms.Path
    key: str | int | None = None

    def value(self, data: Any, at: Sequence[float]) -> Any:
        """Return what the field is to hold with the place ``at``, mm."""
        place = [round(x, _DIGITS) for x in at]
        if self.key is None:
            return place
        written = forms.value_at(data, self.path)
        if isinstance(self.key, str):
            return {**(written if isinstance(written, dict) else {}), self.key: {"at_mm": place}}
        kept = list(written) if isinstance(written, list) else []
        return [*kept[: self.key], {"at_mm": place}, *kept[self.key + 1 :]]


def pick_targets(data: Any) -> tuple[PickTarget, ...]:
    """Return what can be picked for a recipe's vessels; nothing where these aren't grown."""
    part = forms.value_at(data, _AT)
    return tuple(_targets(part)) if isinstance(part, Mapping) else ()


def _targets(part: Mapping[str, Any]) -> Iterator[PickTarget]:
    grow, anatomy = part.get("grow"), part.get("anatomy")
    if grow == "tree" and isinstance(anatomy, Mapping):
        for name in INLETS.get(str(anatomy.get("template")), ()):
            yield PickTarget(name.replace("_", " "), (*_AT, "anatomy", "inlets"), name)
    elif grow == "tree":
        inlets = part.get("inlets")
        count = len(inlets) if isinstance(inlets, list) else 0
        yield PickTarget("a further inlet", (*_AT, "inlets"), count)
        for k in range(count):
            yield PickTarget(f"inlet {k + 1}", (*_AT, "inlets"), k)
    elif grow == "closed_loop":
        yield PickTarget("the artery's inlet", (*_AT, "root_mm"))
        yield PickTarget("the vein's outlet", (*_AT, "vein_root_mm"))
    elif grow == "forest":
        yield from _of_forest(part.get("networks"))


def _of_forest(networks: Any) -> Iterator[PickTarget]:
    for n, network in enumerate(networks if isinstance(networks, list) else ()):
        trees = network.get("trees") if isinstance(network, Mapping) else None
        for k, tree in enumerate(trees if isinstance(trees, list) else ()):
            kind = tree.get("kind", "tree") if isinstance(tree, Mapping) else "tree"
            path = (*_AT, "networks", n, "trees", k, "root_mm")
            yield PickTarget(f"network {n + 1}: {kind} {k + 1}", path)
