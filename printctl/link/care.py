"""Settings for supervising a running print: checkpoints, dead-man's time, syringes, line noise."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from printctl.link.errors import Refused


@dataclass(frozen=True)
class Care:
    """What the link does beside sending lines.

    Attributes
    ----------
    checkpoint_s : float or None, s
        Least time between two checkpoints, which are made where a layer or pass ends; 0 for one
        at each end, None for none.
    deadman_s : float, s
        Unless somebody confirms within this time (`printctl alive`), the print pauses at the next
        mark; 0 for an attended print.
    deadman_stops : bool
        End it by a controlled stop there instead.
    syringe : str
        Profile of the syringe in use, by name or path; empty where nobody said.
    capacity_mm : float, mm
        Plunger travel of a full syringe of this sort; 0 where unknown.
    reload_at : tuple of int
        Reload points, by the command lines before them, at which the syringe must be changed.
    reload_heads : tuple of int
        Of several heads, whose syringe at each; empty where there is one.
    head_syringes : tuple of str
        As `syringe`, of each of several heads.
    head_capacity_mm : tuple of float, mm
        As `capacity_mm`, of each of several heads.
    silent_limit_s : float or None, s
        Without any usable answer for so long a print in progress counts as lost; None for the
        firmware family's own: 60 s, or 1800 s for one line of a firmware that can't be asked.
    noise_window, noise_limit : int
        More than ``noise_limit`` lines sent again among ``noise_window``: the print pauses.
    wire_log : str
        File or folder that all traffic is written to; empty for the last of it, kept in memory.
    accepted : tuple of str
        Checks that failed, and that the user told to print with all the same; for the journal.
    start_mm : tuple of float or None, mm
        Where the checks took the tip to stand before the first line; None where none was made.
    """

    checkpoint_s: float | None = 30.0
    deadman_s: float = 0.0
    deadman_stops: bool = False
    syringe: str = ""
    capacity_mm: float = 0.0
    reload_at: tuple[int, ...] = ()
    reload_heads: tuple[int, ...] = ()
    head_syringes: tuple[str, ...] = ()
    head_capacity_mm: tuple[float, ...] = ()
    accepted: tuple[str, ...] = ()
    silent_limit_s: float | None = None
    noise_window: int = 500
    noise_limit: int = 30
    wire_log: str = ""
    start_mm: tuple[float, float, float] | None = None

    def of_head(self, number: int | None) -> tuple[str, float]:
        """Syringe and capacity of a head; of the only one for None."""
        if number is None or number >= len(self.head_capacity_mm):
            return self.syringe, self.capacity_mm
        return self.head_syringes[number], self.head_capacity_mm[number]

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self)

    @staticmethod
    def from_dict(data: dict[str, Any]) -> Care:
        """Read `to_dict`."""
        lists = ("reload_at", "reload_heads", "head_syringes", "head_capacity_mm", "accepted")
        start = data.get("start_mm")
        told = {"start_mm": tuple(start) if start else None}
        return Care(**{**data, **{name: tuple(data.get(name, ())) for name in lists}, **told})


@dataclass(frozen=True)
class NewSyringe:
    """What was put in at a change of syringe.

    Attributes
    ----------
    plunger_mm : float, mm
        Where its plunger stands: travel that is used up already, 0 for a full one.
    name : str
        Its profile; empty for one like the last.
    capacity_mm : float, mm
        Travel when full; 0 for the same as the last.

    Raises
    ------
    Refused
        When a length is negative or none.
    """

    plunger_mm: float = 0.0
    name: str = ""
    capacity_mm: float = 0.0

    def __post_init__(self) -> None:
        for what, mm in (("plunger", self.plunger_mm), ("capacity", self.capacity_mm)):
            if not isinstance(mm, (int, float)) or not 0 <= mm < math.inf:
                raise Refused(f"a new syringe's {what} of {mm!r} mm is no length of 0 or more")
