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
    """What the link does beside sending lines; raises `Refused` where no look could be made so.

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
    syringe, capacity_mm, used_mm : str, float, float
        Profile of the syringe in use, by name or path; plunger travel of a full one of its sort;
        travel used up at the start, as far as the station knew. Empty or 0 where unknown.
    reload_at, reload_heads : tuple of int
        Reload points, by the command lines before them, at which the syringe must be changed; of
        several heads, whose syringe at each.
    head_syringes, head_capacity_mm : tuple of str, tuple of float
        As `syringe` and `capacity_mm`, of each of several heads.
    accepted : tuple of str
        Checks that failed, and that the user accepts all the same; for the journal.
    silent_limit_s : float or None, s
        Without any usable answer for so long a print in progress counts as lost; None for the
        firmware family's own: 60 s, or 1800 s for one line of a firmware that can't be asked.
    noise_window, noise_limit : int
        More than ``noise_limit`` lines sent again among ``noise_window``: the print pauses.
    wire_log : str
        File or folder that all traffic is written to; empty for the last of it, kept in memory.
    start_mm : tuple of float or None, mm
        Where the checks took the tip to stand before the first line; None where none was made.
    set_up : tuple of str
        Options of `printctl print` that name what is mounted; the rest is printed with them.
    look_after : MarkKind or None
        The print is held for a look (`printctl.machine.control.printing.looking`) where each layer
        or vessel ends.
    look_every_mm, look_every_written_s : float; 0 for no
        Also behind so much written way, or time of writing, since the last look, at the first mark
        of any kind or, in layers, end of a line.
    look_every_height_mm, look_every_s : float; 0 for no
        Also at the first mark where the part is so much higher than at the last look, or so long
        after it.
    look_limit_s : float, s
        A look that is still undecided then becomes a pause for the operator, with an alarm.
    look_park_mm : (x, y, z) or None, mm
        Where the needle waits in a look, counted from the touch-off as the job's checks count;
        None for straight above.
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
    set_up: tuple[str, ...] = ()
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
        intervals = zip(("mm", "s of writing", "mm of height", "s"), self._intervals, strict=True)
        for what, value in intervals:
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
        return any(one > 0 for one in self._intervals[:3])

    @property
    def _intervals(self) -> tuple[float, ...]:
        by_writing = self.look_every_mm, self.look_every_written_s, self.look_every_height_mm
        return *by_writing, self.look_every_s

    def of_head(self, number: int | None) -> tuple[str, float]:
        """Return syringe and capacity of a head; of the only one for None."""
        if number is None or number >= len(self.head_capacity_mm):
            return self.syringe, self.capacity_mm
        return self.head_syringes[number], self.head_capacity_mm[number]

    def to_dict(self) -> dict[str, Any]:
        """Return it as a JSON object."""
        return asdict(self)

    @staticmethod
    def from_dict(data: dict[str, Any]) -> Care:
        """Read `to_dict`."""
        after = data.get("look_after")
        lists = {key: tuple(value) for key, value in data.items() if isinstance(value, list)}
        return Care(**{**data, **lists, "look_after": MarkKind(after) if after else None})


@dataclass(frozen=True)
class NewSyringe:
    """What was put in at a change of syringe; raises `Refused` for a length below 0 or none.

    ``plunger_mm`` is travel that is used up already, 0 for a full one; ``name`` is its profile,
    ``capacity_mm`` travel when full: refused as well where only one of the two is given; with
    neither it is one like the last.
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
