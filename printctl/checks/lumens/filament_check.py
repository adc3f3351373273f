"""Check embedded G-code: each vessel printed continuously and separate from others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from printctl.checks.lumens.filament_sections import measure_filaments
from printctl.checks.lumens.measure import Openings
from printctl.checks.lumens.merges import Merge, find_merges
from printctl.checks.lumens.network import network_lumens
from printctl.checks.lumens.report import LumenReport, report_dict, report_lumens
from printctl.checks.lumens.stations import SectionStations
from printctl.checks.lumens.wording import list_names
from sim.gcode.deposit.strands import Strands

MEANING: Final = (
    "written filaments are taken as sacrificial: the space that they fill is open once they are "
    "washed out"
)
NO_LIMIT_MM: Final = 1e9
JOINT_RADII: Final = 3.0
"""So far about a joint, in radii of its widest vessel, its vessels count as its own."""


@dataclass(frozen=True)
class FilamentCheck:
    """What was found; see `printctl.checks.lumens.check.LumenCheck` for layers.

    Attributes
    ----------
    ideal, stepped : LumenReport
        As written, and as the dry run's motors do it.
    merges : tuple of Merge
    joints : (j,) float64
        Opening of each joint's narrowest vessel over its design, after motor steps; 0 where a
        filament doesn't reach the other.
    filament_mm : float, mm
        Median diameter.
    passes : int
    place_mm : (3,) float64, mm
    left_out : frozenset of int
        Vessels that the plan says aren't written (``toolpath.leave_out``).
    """

    ideal: LumenReport
    stepped: LumenReport
    merges: tuple[Merge, ...]
    joints: FloatArray
    filament_mm: float
    passes: int
    place_mm: FloatArray
    left_out: frozenset[int] = frozenset()

    @property
    def refusal(self) -> str | None:
        """Why this mustn't be printed; None where all is well."""
        broken = np.flatnonzero(self.ideal.closed | self.stepped.closed)
        names = [self.ideal.names[k] for k in broken if k not in self.left_out]
        parts = []
        if names:
            parts.append(
                f"not written through: vessel {list_names(names)} ({len(names)} of "
                f"{len(self.ideal.names)})"
            )
        across = [merge for merge in self.merges if merge.across_trees]
        if across:
            pairs = [f"vessel {m.vessels[0]} with {m.vessels[1]}" for m in across]
            parts.append(f"filaments of two trees merge: {list_names(pairs)}")
        if not parts:
            return None
        return (
            f"{'; '.join(parts)}; plan it again with more overlap at the joints, a finer needle or "
            "more clearance"
        )

    @property
    def notes(self) -> list[str]:
        """What a person should look at."""
        notes = []
        within = [f"{m.vessels[0]} with {m.vessels[1]}" for m in self.merges if not m.across_trees]
        if within:
            notes.append(f"filaments of one tree merge beside their joints: {list_names(within)}")
        if 2 * int(self.ideal.closed.sum()) > len(self.ideal.names):
            notes.append(
                "most vessels aren't written: does the part stand where --place says, and is this "
                "its G-code?"
            )
        return notes

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        report = report_dict(self.ideal, self.stepped, ())
        across = sum(merge.across_trees for merge in self.merges)
        report["summary"] |= {
            "merges": len(self.merges),
            "merges_across_trees": across,
            "joints": len(self.joints),
            "joints_broken": int((self.joints <= 0).sum()),
            "joint_least": float(self.joints.min()) if len(self.joints) else None,
        }
        return {
            "passed": self.refusal is None,
            "method": "filaments",
            "meaning": MEANING,
            "filament_um": 1e3 * self.filament_mm,
            "passes": self.passes,
            **report,
            "merges": [merge.as_dict(self.place_mm) for merge in self.merges],
            "notes": self.notes,
        }


def check_filaments(
    ideal: Strands,
    stepped: Strands,
    network: VesselNetwork,
    place_mm: FloatArray,
    leak_mm: float,
    left_out: frozenset[int] = frozenset(),
) -> FilamentCheck:
    """Hold an embedded print's G-code against the network that it should write.

    Parameters
    ----------
    ideal, stepped : Strands
        As the file says, and as the dry run's motors do it.
    network : VesselNetwork
        In the part's frame.
    place_mm : (3,) float64, mm
        The part's origin in the printer's frame.
    leak_mm : float, mm
        Narrower openings between filaments are none.
    left_out : frozenset of int
        Vessels that aren't to be written: the plan left them out.
    """
    width = 2 * float(np.median(ideal.radius))
    stations = network_lumens(network, place_mm, NO_LIMIT_MM, NO_LIMIT_MM)
    after = measure_filaments(stepped, stations)
    return FilamentCheck(
        report_lumens(stations, measure_filaments(ideal, stations), None, place_mm),
        report_lumens(stations, after, None, place_mm),
        find_merges(ideal, network, place_mm, leak_mm),
        _joints(network, stations, after, place_mm),
        width,
        ideal.passes,
        place_mm,
        left_out,
    )


def _joints(
    network: VesselNetwork, stations: SectionStations, openings: Openings, place_mm: FloatArray
) -> FloatArray:
    """Opening over design at the narrowest of each joint's vessels, near the joint."""
    degree, ends = network.degree(), network.vessel_nodes[stations.lumen]
    least, widest = np.full(len(network.nodes), np.inf), np.zeros(len(network.nodes))
    share = np.minimum(openings.diameter / stations.designed_mm, 1.0)
    for side in (0, 1):
        np.maximum.at(widest, ends[:, side], stations.radius)
    for side in (0, 1):
        node = ends[:, side]
        away = np.linalg.norm(stations.axis - place_mm - network.nodes[node], axis=1)
        near = away <= JOINT_RADII * widest[node]
        np.minimum.at(least, node[near], share[near])
    chosen: FloatArray = least[(degree > 1) & np.isfinite(least)]
    return chosen
