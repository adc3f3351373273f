"""Check lumens in layered G-code: open, as wide as designed, leak-free."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from design.network import VesselNetwork
from design.solids import Solid
from kernels.arrays import FloatArray
from printctl.checks.lumens.leaks import DesignedLumens, Leak, find_leaks, network_trees
from printctl.checks.lumens.lines import WrittenLines
from printctl.checks.lumens.model import model_lumens
from printctl.checks.lumens.report import LumenReport, list_names, report_dict, report_lumens
from printctl.checks.lumens.stations import SectionStations, measure, network_lumens


@dataclass(frozen=True)
class LumenCheck:
    """Result of checking lumens in G-code.

    Attributes
    ----------
    ideal, stepped : LumenReport
        On the lines as written, and between the motors' whole steps; of a pneumatic head as the
        dry run lays them.
    leaks : tuple of Leak
        Places are in the part's frame.
    line_mm, layer_mm : float, mm
        Median width of a line, and thickness of a layer.
    doubt_mm : tuple of float, mm
        How much narrower and wider the lumens may be, as their lines' bead wasn't measured.
    unfollowed : int
        Ways through the part that its sections don't show, so that they weren't checked.
    remedy : str
        What was tried and helps against what is closed or leaks; by default the refusal says what
        the geometry asks for.
    """

    ideal: LumenReport
    stepped: LumenReport
    leaks: tuple[Leak, ...]
    line_mm: float
    layer_mm: float
    doubt_mm: tuple[float, float] = (0.0, 0.0)
    unfollowed: int = 0
    remedy: str = ""

    @property
    def refusal(self) -> str | None:
        """Why this mustn't be printed; None where all is well."""
        closed = np.flatnonzero(self.ideal.closed | self.stepped.closed)
        parts = []
        if len(closed):
            names = [self.ideal.names[k] for k in closed]
            parts.append(
                f"closed: lumen {list_names(names)} ({len(names)} of {len(self.ideal.names)})"
            )
        if self.leaks:
            parts.append(f"leaking: {list_names([leak.text for leak in self.leaks])}")
        if parts:
            return f"{'; '.join(parts)}; {self.remedy or self.by_geometry()}"
        if self.unfollowed:
            return (
                f"not checked: ways through the part that lie level, {self.unfollowed}, as its "
                "sections don't show them as holes; give the vessels as --network"
            )
        return None

    def by_geometry(self) -> str:
        """What the design needs for lines of this width."""
        needs = []
        if any(leak.wall_mm is not None and leak.wall_mm <= 0 for leak in self.leaks):
            needs.append("let these vessels open through one face, clear of its edges")
        if any(leak.wall_mm is None or leak.wall_mm > 0 for leak in self.leaks):
            needs.append(f"make these walls thicker than a line ({self.line_mm:.3g} mm)")
        if (self.ideal.closed | self.stepped.closed).any():
            needs.append("make these lumens wider")
        return "in the design, " + " and ".join(needs)

    @property
    def notes(self) -> list[str]:
        """What a person should look at."""
        if 2 * int(self.ideal.closed.sum()) > len(self.ideal.names):
            return [
                "most lumens are closed: does the part stand where --place says, and is this its "
                "G-code?"
            ]
        return []

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "passed": self.refusal is None,
            "method": "layers",
            "line_um": 1e3 * self.line_mm,
            "layer_um": 1e3 * self.layer_mm,
            "bead_uncertainty_um": [1e3 * value for value in self.doubt_mm],
            **report_dict(self.ideal, self.stepped, self.leaks),
            "unfollowed": self.unfollowed,
            "notes": self.notes,
        }


def check_network(
    lines: WrittenLines,
    network: VesselNetwork,
    place_mm: FloatArray,
    stepped: WrittenLines,
    leak_mm: float,
) -> LumenCheck:
    """Hold G-code against the network that it should leave open.

    Parameters
    ----------
    lines : WrittenLines
    network : VesselNetwork
        In the part's frame.
    place_mm : (3,) float64, mm
        The part's origin in the printer's frame.
    stepped : WrittenLines
        The same between motor steps: `rounded_to_steps`, or what a dry run lays.
    leak_mm : float, mm
        Narrower ways are no leaks.
    """
    stations = network_lumens(network, place_mm, _layer(lines), _line(lines))
    trees = network_trees(network, lines, place_mm)
    return _check(lines, stations, trees, place_mm, stepped, leak_mm)


def check_model(
    lines: WrittenLines,
    part: Solid,
    place_mm: FloatArray,
    stepped: WrittenLines,
    leak_mm: float,
) -> LumenCheck:
    """Hold G-code against the holes of the part's own sections; see `check_network`.

    Raises
    ------
    UsageError
        When the part has no hole.
    """
    stations, trees, unfollowed = model_lumens(part, lines, place_mm)
    check = _check(lines, stations, trees, place_mm, stepped, leak_mm)
    return replace(check, unfollowed=unfollowed)


def _check(
    lines: WrittenLines,
    stations: SectionStations,
    trees: DesignedLumens,
    place: FloatArray,
    stepped: WrittenLines,
    leak_mm: float,
) -> LumenCheck:
    leaks = find_leaks(lines, trees, leak_mm)
    return LumenCheck(
        report_lumens(stations, measure(lines, stations), lines, place),
        report_lumens(stations, measure(stepped, stations), lines, place),
        tuple(replace(leak, at_mm=leak.at_mm - place) for leak in leaks),
        _line(lines),
        _layer(lines),
        (-lines.doubt_mm[0], -lines.doubt_mm[1]),
    )


def _line(lines: WrittenLines) -> float:
    return float(np.median(lines.width))


def _layer(lines: WrittenLines) -> float:
    return float(np.median(lines.high - lines.low))
