"""Record type of a firmware's serial abilities: its protocol, line pairing, resume, quick stop."""

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
    withholds : bool
        Whether the second of them leaves but for its end.
    receive_buffer_bytes : int
        Of the board.
    places : callable
        See `firmware_profiles.families.link_protocol.Places`.
    """

    timing: Timing
    lines_in_flight: int
    receive_buffer_bytes: int
    places: Places
    withholds: bool = False


@dataclass(frozen=True, kw_only=True)
class LinkFacts:
    """What the link knows of a family.

    Attributes
    ----------
    says : str
        What its FIRMWARE_NAME (M115) contains, in small letters.
    make_protocol : callable
        Makes the state machine that speaks to it.
    verified : bool
        Whether a real one's transcripts were replayed against the state machine.
    keepalive : bool
        Whether it can be told to say that it is busy (M113).
    tells_steps : bool
        Whether M92 tells the steps per mm.
    remembers : bool
        Whether it can be asked which line it took last, so that a print can be gone on with
        after the host died.
    pairs : bool
        Whether two lines may be in flight: it counts them, and that was tried.
    cuts_long_lines : bool
        Whether a line longer than the receive buffer is cut.
    m84_sets_timeout : bool
        Whether ``M84 S`` sets the time after which idle motors lose their power; else it takes
        the power at once, or does something else.
    plans_by_time : bool
        Whether it plans ahead by time, so that nobody knows how many moves are under way.
    complains_to_all : bool
        Whether it tells every client what is wrong with any client's command.
    place_question : bytes
        Question that is answered with places and what they are shifted by, of a family in whose
        answers other clients' commands leave no trace; empty for others.
    axes_question : bytes
        Question whose answer holds ``Cartesian`` where each axis has its motor, of a family whose
        M114 tells motors' steps for any kind of axes; empty for others.
    rest_question : bytes
        Question that the board itself answers once its motors rest, where another computer answers
        M400, which may not know yet that the board is gone. Empty for none.
    run_on_s : float, s
        Longest time for which its motors go on after it has halted; 0 where nobody knows.
    quickstop : bytes
        Command that stops its motors at once, drops the moves that it holds and is answered when
        the position is counted from the motors' steps; with an emergency parser before its turn.
        Empty for none.
    ends_waits : bytes
        Command that ends a wait for heat before its turn, the target unchanged. Empty for none.
    """

    says: str
    make_protocol: Callable[[LinkSetup], LinkProtocol]
    verified: bool = False
    keepalive: bool = False
    tells_steps: bool = False
    remembers: bool = False
    pairs: bool = False
    cuts_long_lines: bool = False
    m84_sets_timeout: bool = False
    plans_by_time: bool = False
    complains_to_all: bool = False
    place_question: bytes = b""
    axes_question: bytes = b""
    rest_question: bytes = b""
    run_on_s: float = 0.0
    quickstop: bytes = b""
    ends_waits: bytes = b""
