"""Settings for supervising a print: checkpoints, dead-man's time, inspections, syringes, noise."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from printctl.machine.errors import Refused
from printctl.machine.job.marks import MarkKind

_LOOK_KINDS = (None, MarkKind.LAYER, MarkKind.VESSEL)


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
    used_mm : float, mm
        Travel that its plunger had used up at the start, as far as the station knew.
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
    look_after : MarkKind or None
        The print is held for a look (`printctl.machine.control.looking`) where each layer or vessel
        ends.
    look_every_mm : float, mm
        Also behind so much written way since the last look, at the first mark of any kind or, in
        layers, end of a line; 0 for no.
    look_every_written_s : float, s
        The same behind so much time of writing.
    look_every_height_mm : float, mm
        Also at the first mark where the part has become so much higher since the last look.
    look_every_s : float, s
        Also at the first mark of any kind so long after the last look; 0 for no.
    look_limit_s : float, s
        A look that nobody has decided by then becomes a pause for the operator, with an alarm.
    look_park_mm : (x, y, z) or None, mm
        Where the needle waits in a look, counted from the touch-off as the job's checks count;
        None for straight above.

    Raises
    ------
    Refused
        When what is said of looks makes no sense.
    """

    checkpoint_s: float | None = 30.0
    deadman_s: float = 0.0
    deadman_stops: bool = False
    syringe: str = ""
    capacity_mm: float = 0.0
    used_mm: float = 0.0
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
    look_after: MarkKind | None = None
    look_every_mm: float = 0.0
    look_every_written_s: float = 0.0
    look_every_height_mm: float = 0.0
    look_every_s: float = 0.0
    look_limit_s: float = 120.0
    look_park_mm: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.look_after not in _LOOK_KINDS:
            raise Refused(f"looks can't be made after each {self.look_after}: layer or vessel")
        intervals = {
            "mm": self.look_every_mm,
            "s of writing": self.look_every_written_s,
            "mm of height": self.look_every_height_mm,
            "s": self.look_every_s,
        }
        for what, value in intervals.items():
            if not 0 <= value < math.inf:
                raise Refused(f"a look every {value!r} {what} is no length of 0 or more")
        if not 0 < self.look_limit_s < math.inf:
            raise Refused(
                f"look_limit_s is {self.look_limit_s!r}, and a look must end some time: give "
                "seconds above 0, after which the print pauses for the operator"
            )
        park = self.look_park_mm
        if park is not None and not (len(park) == 3 and all(map(math.isfinite, park))):
            raise Refused(f"park_mm {park!r} is no place: give x, y and z in mm")

    @property
    def looks(self) -> bool:
        """Whether the print is held for looks at all."""
        return bool(self.look_after or self.looks_by_writing or self.look_every_s)

    @property
    def looks_by_writing(self) -> bool:
        """Whether looks are due by what was written since the last one."""
        every = (self.look_every_mm, self.look_every_written_s, self.look_every_height_mm)
        return any(one > 0 for one in every)

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
        start, park, after = (data.get(key) for key in ("start_mm", "look_park_mm", "look_after"))
        told = {
            "start_mm": tuple(start) if start else None,
            "look_park_mm": tuple(park) if park else None,
            "look_after": MarkKind(after) if after else None,
        }
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
        Travel when full; with a name above 0, without one 0: the same as the last.

    Raises
    ------
    Refused
        When a length is negative or none, or the name and its capacity don't come together.
    """

    plunger_mm: float = 0.0
    name: str = ""
    capacity_mm: float = 0.0

    def __post_init__(self) -> None:
        for what, mm in (("plunger", self.plunger_mm), ("capacity", self.capacity_mm)):
            if not isinstance(mm, (int, float)) or not 0 <= mm < math.inf:
                raise Refused(f"a new syringe's {what} of {mm!r} mm is no length of 0 or more")
        if bool(self.name) != (self.capacity_mm > 0):
            raise Refused(
                f"a new syringe {self.name!r} with {self.capacity_mm:g} mm of travel: give its "
                "profile and a travel above 0, or neither for one like the last"
            )
