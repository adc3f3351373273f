"""Places of a recipe's vessels that are picked on its tissue."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from printctl.recipe.anatomy import INLETS
from printctl.web.design.schema import KeyPath


@dataclass(frozen=True)
class PickTarget:
    """A field of a recipe that a click on the tissue's surface can set.

    Attributes
    ----------
    name : str
        As the page calls it.
    path : tuple of str or int
    key : str
        Under which the place, mm, stands there; empty where the field is the place itself.
    """

    name: str
    path: KeyPath
    key: str = ""


_AT: Final = ("vasculature",)
_INLET: Final = "at_mm"


def pick_targets(data: Any) -> tuple[PickTarget, ...]:
    """Return what can be picked for a recipe's vessels; nothing where these aren't grown."""
    part = data.get(_AT[0]) if isinstance(data, Mapping) else None
    return tuple(_targets(part)) if isinstance(part, Mapping) else ()


def _targets(part: Mapping[str, Any]) -> Iterator[PickTarget]:
    grow, anatomy = part.get("grow"), part.get("anatomy")
    if grow == "tree" and isinstance(anatomy, Mapping):
        for name in INLETS.get(str(anatomy.get("template")), ()):
            path = (*_AT, "anatomy", "inlets", name)
            yield PickTarget(name.replace("_", " "), path, _INLET)
    elif grow == "tree":
        inlets = part.get("inlets")
        count = len(inlets) if isinstance(inlets, list) else 0
        yield PickTarget("a further inlet", (*_AT, "inlets", count), _INLET)
        for k in range(count):
            yield PickTarget(f"inlet {k + 1}", (*_AT, "inlets", k), _INLET)
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
