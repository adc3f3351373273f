"""Planned faults of a simulated printer: cable, clock, ink; with fault file and simulated gauge.

Goes in: a fault file. Comes out: a cable, a clock or a gauge that misbehaves as planned.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterator
from itertools import cycle
from typing import Annotated, ClassVar, Final, Literal, get_args

import numpy as np
from pydantic import Field, model_validator

from gcode.deposit.ink_faults import InkFault, InkFaults
from gcode.errors import SimError
from gcode.user_files import FileSection, UserFile
from sim.errors import ServeError

# A fault file is YAML::
#
# seed: 7
# noise: 0.0004            # chance of each byte that one of its bits flips
# noise_on: both           # or down (to the printer), up (from it)
# drop_ok: 0.001           # chance of each ok
# delay: 0.001             # chance of each reply that it comes delay_s late
# delay_s: 0.3
# ok_delays_s: [0, 0, 5]   # oks come so late, each in turn, and what follows each with it
# drop_byte: 0.0001        # chance of each byte that it is lost
# speed: 0.5               # the whole board runs at this share of its time
# latency_s: 0.016         # every reply comes so late, as through a USB adapter
# at:                      # moments: by line number, printer's clock or bytes received
# - {fault: noise, line: 100, rate: 0.05, length_bytes: 400}
# - {fault: unplug, line: 2000, back_after_s: 2}
# - {fault: endstop_stuck, time_s: 0, axis: x, stuck: open}
# - {fault: runaway, bytes: 50000}
# - {fault: stall, line: 300, seconds: 4}
# gauges:                  # what it tells of a sensor: straight between times, by its clock
# - {command: M871, says: "Force: {value:.2f} N", ramp: [[0, 1.0], [60, 15.0]]}
# ink:                     # what becomes of the ink; the motors know nothing of it
# - {fault: clog, written_mm: 120, clears_ul: 0.5}   # all kinds: gcode.deposit.ink_faults
FaultKind = Literal[
    "unplug",
    "reset",
    "kill",
    "drop_ok",
    "runaway",
    "noise",
    "delay",
    "stall",
    "endstop_stuck",
]
Direction = Literal["both", "down", "up"]
Chance = Annotated[float, Field(ge=0, le=1)]
Seconds = Annotated[float, Field(ge=0, le=86_400)]
_OWN: Final[dict[str, tuple[str, ...]]] = {
    "unplug": ("back_after_s",),
    "noise": ("rate", "length_bytes"),
    "delay": ("seconds",),
    "stall": ("seconds",),
    "endstop_stuck": ("axis", "stuck"),
}
"""Keys that only one fault has; all but ``back_after_s`` must be given."""


class Fault(FileSection):
    """Something that goes wrong at a moment.

    Attributes
    ----------
    fault : FaultKind
        ``unplug``: the cable is pulled, and plugged in again where `back_after_s` says when.
        ``reset``: the board starts anew. ``kill``: the firmware stops itself (a thermal runaway
        out of the blue). ``drop_ok``: the ok to the line is lost. ``runaway``: the hotend's heater
        loses its power while the firmware believes it is on. ``noise``: `rate` of the next
        `length_bytes` on the cable are garbled. ``delay``: the next reply is `seconds` late.
        ``stall``: board, motors and wire stand still for `seconds`, and go on. ``endstop_stuck``:
        `axis`' switch stays ``open`` (never found) or ``closed`` (found at once, wherever the
        carriage stands).
    line, time_s, bytes
        The moment: when the firmware takes the line of this N word, when its clock shows this,
        or when it has received so many bytes. One of them.
    """

    fault: FaultKind
    line: Annotated[int, Field(ge=0)] | None = None
    time_s: Annotated[float, Field(ge=0)] | None = None
    bytes: Annotated[int, Field(ge=0)] | None = None
    back_after_s: Seconds | None = None
    rate: Chance | None = None
    length_bytes: Annotated[int, Field(ge=1)] | None = None
    seconds: Seconds | None = None
    axis: Literal["x", "y", "z"] | None = None
    stuck: Literal["open", "closed"] | None = None

    @model_validator(mode="after")
    def _belongs_together(self) -> Fault:
        if sum(v is not None for v in (self.line, self.time_s, self.bytes)) != 1:
            raise ValueError("give one of line, time_s and bytes as the moment")
        if self.fault == "drop_ok" and self.line is None:
            raise ValueError("drop_ok is the ok to a line: give line")
        mine = _OWN.get(self.fault, ())
        for kind, keys in _OWN.items():
            for key in keys:
                given = getattr(self, key) is not None
                if given and key not in mine:
                    raise ValueError(f"{key} belongs to {kind}, not to {self.fault}")
                if not given and kind == self.fault and key != "back_after_s":
                    raise ValueError(f"{kind} needs {key}")
        return self


class PermanentFaults(FileSection):
    """What is wrong with cable and board all the time, most of it as a chance; see the module."""

    noise: Chance = 0.0
    noise_on: Direction = "both"
    drop_ok: Chance = 0.0
    delay: Chance = 0.0
    delay_s: Seconds = 0.3
    ok_delays_s: tuple[Seconds, ...] = ()
    drop_byte: Chance = 0.0
    speed: Annotated[float, Field(ge=0.01, le=1)] = 1.0
    latency_s: Seconds = 0.0


class Gauge(FileSection):
    """A sensor that a firmware with an M command of its own would tell of.

    Attributes
    ----------
    command : str
        Which asks for it, such as M871.
    says : str
        The answer, with ``{value}`` where the number stands; it may have a format,
        ``{value:.2f}``. An answer without it is unreadable.
    ramp : tuple of (time, value)
        Straight between them by the printer's clock, s; constant before and after.
    """

    command: Annotated[str, Field(pattern=r"^M\d+$")]
    says: Annotated[str, Field(min_length=1, max_length=100)]
    ramp: Annotated[tuple[tuple[float, float], ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _can_be_said(self) -> Gauge:
        times = [time for time, _ in self.ramp]
        if times != sorted(set(times)):
            raise ValueError("the ramp's times must ascend")
        try:
            self.at(0.0)
        except (KeyError, IndexError, ValueError) as exc:
            raise ValueError(f"says {self.says!r} can't be filled in with a value: {exc}") from exc
        return self

    def at(self, time_s: float) -> str:
        """The answer at a moment of the printer's clock."""
        times, values = zip(*self.ramp, strict=True)
        return self.says.format(value=float(np.interp(time_s, times, values)))


class FaultFile(PermanentFaults, UserFile):
    """A fault file; see the module."""

    called: ClassVar[str] = "fault file"
    error: ClassVar[type[SimError]] = ServeError

    seed: Annotated[int, Field(ge=0)] = 0
    at: tuple[Fault, ...] = ()
    gauges: tuple[Gauge, ...] = ()
    ink: tuple[InkFault, ...] = ()

    @property
    def of_ink(self) -> InkFaults:
        """Faults of the ink, with the file's seed."""
        return InkFaults(self.ink, self.seed)


_FAULT: Final = re.compile(r"([a-z_]+)@(\d+)")


def parse_fault(text: str) -> Fault:
    """Read ``unplug@120``: a fault without further keys, at a line.

    Raises
    ------
    ServeError
        When it isn't one.
    """
    match = _FAULT.fullmatch(text)
    kinds = [kind for kind in get_args(FaultKind) if kind not in _OWN or kind == "unplug"]
    if match is None or match[1] not in kinds:
        raise ServeError(
            f"fault {text!r} isn't one of {', '.join(f'{kind}@LINE' for kind in kinds)}; "
            "others go into a fault file"
        )
    return Fault.model_validate({"fault": match[1], "line": int(match[2])})


# Modelled: one bit of a byte flips, each byte by itself at the same chance, or of a burst's bytes
# at the burst's; a byte is lost; a bare ``ok`` is lost whole; a reply, or each ``ok`` by its own
# delay, comes late, and what is behind it no sooner: so oks come bunched.
# Not modelled: bytes that are invented, framing errors, noise that comes in bursts of its
# own accord, what a USB adapter's packets do to the gaps between bytes.
#
# Whoever owns the cable has the clock: the process that serves the printer real seconds, a
# transport in virtual time that clock's.
_OK: Final = re.compile(rb"(?m)^ok\n")
_BEGINS_OK: Final = re.compile(rb"(?m)^ok")


class FaultyCable:
    """Simulated cable with errors.

    Parameters
    ----------
    rng : Generator, optional
        Of what goes wrong; needed where anything does by chance.
    """

    def __init__(
        self, troubles: PermanentFaults | None = None, rng: np.random.Generator | None = None
    ) -> None:
        self.troubles = troubles or PermanentFaults()
        self._rng = rng or np.random.default_rng(0)
        self._late: deque[tuple[float, bytes]] = deque()
        self._burst_rate, self._burst_left = 0.0, 0
        self._hold_s = 0.0
        self._ok_delays_s = cycle(self.troubles.ok_delays_s or (0.0,))

    def burst(self, rate: float, length_bytes: int) -> None:
        """Garble ``rate`` of the next ``length_bytes``, both ways."""
        self._burst_rate, self._burst_left = rate, length_bytes

    def hold(self, seconds: float) -> None:
        """Let the next reply come ``seconds`` late."""
        self._hold_s = seconds

    def down(self, data: bytes) -> bytes:
        """What of the host's bytes reaches the printer."""
        return self._garble(data, "down")

    def up(self, data: bytes, now: float) -> None:
        """The printer says something at ``now``, s; `due` gives it to the host."""
        troubles, rng = self.troubles, self._rng
        if troubles.drop_ok:
            data = _OK.sub(lambda m: b"" if rng.random() < troubles.drop_ok else m[0], data)
        if not data:
            return
        late, self._hold_s = troubles.latency_s + self._hold_s, 0.0
        if troubles.delay and rng.random() < troubles.delay:
            late += troubles.delay_s
        for part, ok_late in self._by_ok(data):
            after = self._late[-1][0] if self._late else 0.0
            self._late.append((max(after, now + late + ok_late), self._garble(part, "up")))

    def _by_ok(self, data: bytes) -> Iterator[tuple[bytes, float]]:
        """Cut before each ok that is late, and say how much."""
        if not self.troubles.ok_delays_s:
            yield data, 0.0
            return
        begin, late = 0, 0.0
        for match in _BEGINS_OK.finditer(data):
            if match.start() > begin:
                yield data[begin : match.start()], late
            begin, late = match.start(), next(self._ok_delays_s)
        yield data[begin:], late

    @property
    def next_s(self) -> float:
        """When the next reply reaches the host, s; infinite for none."""
        return self._late[0][0] if self._late else math.inf

    def due(self, now: float) -> bytes:
        """The next reply, if it has reached the host by ``now``, s."""
        return self._late.popleft()[1] if self._late and self._late[0][0] <= now else b""

    def clear(self) -> None:
        """Lose what is under way: the cable was pulled."""
        self._late.clear()

    def _garble(self, data: bytes, direction: Direction) -> bytes:
        on = self.troubles.noise_on in ("both", direction)
        if on and self.troubles.drop_byte:
            kept = self._rng.random(len(data)) >= self.troubles.drop_byte
            data = np.frombuffer(data, np.uint8)[kept].tobytes()
        rate = self.troubles.noise if on else 0.0
        if not rate and not self._burst_left:
            return data
        rates = np.full(len(data), rate)
        rates[: self._burst_left] = np.maximum(rates[: self._burst_left], self._burst_rate)
        self._burst_left = max(self._burst_left - len(data), 0)
        hit = self._rng.random(len(data)) < rates
        if not hit.any():
            return data
        bits = (1 << self._rng.integers(0, 8, len(data))).astype(np.uint8)
        return bytes(np.frombuffer(data, np.uint8) ^ np.where(hit, bits, 0).astype(np.uint8))


class Pace:
    """Clocks of board and host: both start at 0 and run in proportion, but while the board stalls.

    Parameters
    ----------
    share : float
        Board's seconds in one of the host's.
    """

    def __init__(self, share: float = 1.0) -> None:
        self.share = share
        self._stalls: list[tuple[float, float]] = []

    def stall(self, board_s: float, seconds: float) -> None:
        """Stand still at ``board_s``, s, for so long of the host's time."""
        self._stalls.append((board_s, seconds))

    def board_time(self, host_s: float) -> float:
        """What the board's clock shows at a moment of the host's, s."""
        for board_s, seconds in self._stalls:
            if host_s <= board_s / self.share:
                break
            host_s = max(board_s / self.share, host_s - seconds)
        return host_s * self.share

    def host_time(self, board_s: float) -> float:
        """When, on the host's clock, the board's shows this first after a stall, s."""
        stood = sum(seconds for begin_s, seconds in self._stalls if begin_s <= board_s)
        return board_s / self.share + stood
