"""Facts of a firmware family."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from firmware_profiles.families.link_protocol import LinkProtocol, Places
from firmware_profiles.families.link_timing import Timing


@dataclass(frozen=True)
class LinkSetup:
    """Everything that a link protocol is made from.

    Attributes
    ----------
    timing : Timing
    lines_in_flight : int
        1, or 2 where two lines may leave together.
    receive_buffer_bytes : int
        Of the board.
    places : callable
        See `firmware_profiles.families.link_protocol.Places`.
    """

    timing: Timing
    lines_in_flight: int
    receive_buffer_bytes: int
    places: Places


@dataclass(frozen=True)
class Family:
    """A firmware family.

    Attributes
    ----------
    says : str
        What its FIRMWARE_NAME (M115) contains, in small letters.
    make_protocol : callable or None
        Makes the state machine that speaks to it; None where a host sends it no lines.
    verified : bool
        Whether a real one's transcripts were replayed against the state machine.
    keepalive : bool
        Whether it can be told to say that it is busy (M113).
    tells_steps : bool
        Whether M92 tells the steps per mm.
    remembers : bool
        Whether it can be asked which line it took last, so that a print can be gone on with
        after the host died.
    """

    says: str
    make_protocol: Callable[[LinkSetup], LinkProtocol] | None = None
    verified: bool = False
    keepalive: bool = True
    tells_steps: bool = True
    remembers: bool = True
