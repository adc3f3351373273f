"""Arrays of a plate job's map: each line's well; all wells' vessels for the needle shaft check."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, repeat
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from design.toolpath.embedded import Bundles
from printctl.checks.preflight import well_arrays
from printctl.pipeline.plate.wells import PlateRun
from printctl.pipeline.stages.toolpath import written_beside, written_bundles
from printctl.recipe.making import Fresh

_NETWORK: Final = ("nodes", "vessel_nodes", "offset", "points", "radius")


@dataclass(frozen=True)
class WellBundles:
    """The strands of an embedded job.

    Attributes
    ----------
    each : sequence of Bundles
        Of every well, in the printing order.
    whole : Bundles
        All of them, vessels and strands numbered on from well to well.
    """

    each: Sequence[Bundles]
    whole: Bundles


def bundles_of(run: PlateRun) -> WellBundles | None:
    """Strands of each well; None for layers."""
    if isinstance(run.whole.recipe.toolpath, Fresh):
        return None
    own = {name: written_bundles(of) for name, of in run.runs.items()}
    each = [own[run.run_of(well).folder.name] for well in run.wells]
    vessels = [0, *accumulate(run.run_of(well).network.vessel_count for well in run.wells)]
    owner = [one.owner + first for one, first in zip(each, vessels, strict=False)]
    places = [run.place_of(well) for well in run.wells]
    strands = [one.network.moved(place) for one, place in zip(each, places, strict=True)]
    return WellBundles(each, Bundles(combine_networks(strands), np.concatenate(owner)))


def first_sources(bundles: WellBundles | None) -> Iterator[int]:
    """What to add to each well's sources so that no two strands share one; layers begin anew."""
    if bundles is None:
        return repeat(0)
    return iter([0, *accumulate(len(one.owner) for one in bundles.each)])


def wells_in_map(run: PlateRun, well_of_line: Sequence[NDArray[np.int16]]) -> dict[str, Any]:
    """Which well each line is of, what the wells are called, and where all of the plate's are."""
    standing = run.standing
    names = standing.plate.wells
    return {
        "well": np.concatenate(well_of_line),
        "wells": np.array([well.name for well in run.wells]),
        "labels": np.array([well.label for well in run.wells]),
        **well_arrays(
            names,
            np.array([standing.centre_mm(name) for name in names]),
            standing.dish,
            standing.floor_mm,
            standing.bath_mm,
            standing.safe_z_mm,
        ),
    }


def written_in_all(run: PlateRun, bundles: WellBundles) -> dict[str, NDArray[Any]]:
    """The vessels of all wells in the printer's frame, for the check of the needle's shaft."""
    each = [
        written_beside(run.run_of(well), own, ahead=False)
        for well, own in zip(run.wells, bundles.each, strict=True)
    ]
    whole = combine_networks(
        [run.run_of(well).written_network.moved(run.place_of(well)) for well in run.wells]
    )
    arrays = {f"network_{name}": getattr(whole, name) for name in _NETWORK}
    for name in ("overlap_radii", "clearance_mm"):
        arrays[name] = np.array(max(float(one[name]) for one in each))
    if not bundles.whole.is_plain:
        arrays["bundled"] = np.bincount(bundles.whole.owner) > 1
    return arrays | {"needles_mm": each[0]["needles_mm"], "place_mm": np.zeros(3)}


def combine_networks(networks: Sequence[VesselNetwork]) -> VesselNetwork:
    """Networks that don't touch as one, their vessels one after another."""
    nodes = np.append(0, np.cumsum([len(one.nodes) for one in networks]))
    points = np.append(0, np.cumsum([len(one.points) for one in networks]))
    numbered = list(zip(networks, nodes, points, strict=False))
    return VesselNetwork(
        nodes=np.concatenate([one.nodes for one in networks]),
        vessel_nodes=np.concatenate([one.vessel_nodes + node for one, node, _ in numbered]),
        kind=np.concatenate([one.kind for one in networks]),
        tree=np.concatenate([one.tree for one in networks]),
        offset=np.concatenate([[0], *(one.offset[1:] + point for one, _, point in numbered)]),
        points=np.concatenate([one.points for one in networks]),
        radius=np.concatenate([one.radius for one in networks]),
    )
