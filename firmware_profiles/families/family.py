"""Record type of a firmware family: serial link, known commands, dialect, safety rules, heads."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from firmware_profiles.families.dialect import Dialect
from firmware_profiles.families.grammar import Grammar
from firmware_profiles.families.link_protocol import LinkProtocol, Places, Timing

if TYPE_CHECKING:
    from firmware_profiles.printers import Printer


# Per-firmware rules for the command filter: extra codes allowed, pre-job queries and resets.


@dataclass(frozen=True)
class AllowQuery:
    """Let a question pass; with other letters than these the code sets something."""

    letters: str = ""


@dataclass(frozen=True)
class AllowValues:
    """Let a setting pass that takes another back: these words with these values alone.

    Attributes
    ----------
    values : mapping
        Letter or key to the one value it may have.
    remedy : str
        What to do instead of another value.
    """

    values: Mapping[str, float]
    remedy: str


@dataclass(frozen=True)
class AllowOffsetReset:
    """Let a head's offset pass whose words are all 0.

    Attributes
    ----------
    head : str
        Letter of the head's number.
    """

    head: str


@dataclass(frozen=True)
class Advance:
    """Let a setting of pressure advance pass that says what the profile says.

    Attributes
    ----------
    key : str
        Letter or key of the value, s.
    """

    key: str


@dataclass(frozen=True)
class CheckNamedHeater:
    """Judge the target of a heater that is told by its name.

    Attributes
    ----------
    key : str
        Names the heater.
    heaters : mapping
        Name to what it heats: ``nozzle`` or ``bed``.
    numbered : str
        What a name begins with that a nozzle's number follows.
    targets : tuple of str
        Keys of temperatures, °C, the lowest first.
    """

    key: str
    heaters: Mapping[str, str]
    numbered: str
    targets: tuple[str, ...]


@dataclass(frozen=True)
class Timeout:
    """Let the firmware's own switch-off pass that is neither too short nor too long.

    Attributes
    ----------
    key : str
        Of its seconds.
    """

    key: str


@dataclass(frozen=True)
class Keys:
    """Let a command with a name pass that has some of these keys, and no other.

    Attributes
    ----------
    spans : mapping
        Key to the least and greatest number it may have; None for a text.
    needs : tuple of str
        Keys that must be there.
    """

    spans: Mapping[str, tuple[float, float] | None]
    needs: tuple[str, ...] = ()


@dataclass(frozen=True)
class ChooseHead:
    """Let a head pass that the printer has, named as `HeadFacts.select` says."""


Rule = (
    AllowQuery
    | AllowValues
    | AllowOffsetReset
    | Advance
    | CheckNamedHeater
    | Timeout
    | Keys
    | ChooseHead
)


@dataclass(frozen=True)
class GateFacts:
    """A family's own part of the gate.

    Attributes
    ----------
    console, job : mapping of str to Rule
        By code: what these doors let pass beside what all families take.
    questions : tuple of str
        Asked before a start; none of it sets anything.
    resets : tuple of str
        Sent before a start because the firmware doesn't tell what is set.
    speed_per_s : float
        What M203 is told per: 1 for mm/s, 60 for mm/min.
    awaits_cooling : frozenset of str
        Codes that wait until it has cooled to S, too, not only until it is as warm.
    """

    console: Mapping[str, Rule] = field(default_factory=dict)
    job: Mapping[str, Rule] = field(default_factory=dict)
    questions: tuple[str, ...] = ()
    resets: tuple[str, ...] = ()
    speed_per_s: float = 1.0
    awaits_cooling: frozenset[str] = frozenset()


# Record types for job writing and checks: firmware idle timeout, cold extrusion, head changes.


@dataclass(frozen=True)
class IdleTimeout:
    """The firmware's own switch-off when the host is silent.

    Attributes
    ----------
    code : str
        Command that sets it.
    key : str
        Of the seconds, where the command has a name; empty for the word S.
    example : str
        The command as it may be written, for a message.
    """

    code: str
    key: str
    example: str

    def command(self, seconds: str) -> str:
        """Write the command that sets it."""
        return f"{self.code} {self.key}={seconds}" if self.key else f"{self.code} S{seconds}"


@dataclass(frozen=True)
class ColdExtrusion:
    """How a firmware is told to move the plunger without a hot end.

    Attributes
    ----------
    remedy : str
        What to do where it doesn't.
    reads : callable
        What M302 with such words says: 1 allows, -1 forbids, 0 neither.
    """

    remedy: str
    reads: Callable[[Mapping[str, float]], int]


@dataclass(frozen=True, kw_only=True)
class HeadFacts:
    """How a firmware changes between several heads.

    Attributes
    ----------
    select : pattern
        Command that chooses a head; its group is the head's number, empty for 0.
    example : str
        Such a command, for a message.
    confirms : callable
        How a line ends by which it says that it uses head ``number``, one of several ways; none
        where it says nothing.
    macro_free : str
        Word and number without which a choice of head may run macros that move; empty for none.
    offset_code, offset_word : str
        Command by which it is told a head's offset, and the word for the head; empty for none.
    offset_needs_word : bool
        Whether that command without the word is another one; else it is about the head in use.
    first_offset : int
        First head that can have an offset.
    note : str
        What to see to where the heads' steps differ; empty for nothing.
    """

    select: re.Pattern[str]
    example: str
    confirms: Callable[[int], tuple[bytes, ...]] = lambda number: ()
    macro_free: str = ""
    offset_code: str = ""
    offset_word: str = ""
    offset_needs_word: bool = False
    first_offset: int = 0
    note: str = ""

    def number(self, select: str) -> int | None:
        """Head that a command chooses; None for any other command."""
        match = self.select.fullmatch(select)
        return int(match[1] or 0) if match else None


@dataclass(frozen=True)
class ConfigurationFacts:
    """Things that stand in the firmware's configuration, where nothing tells them.

    Attributes
    ----------
    place : str
        Its file.
    remedy : str
        What a person must see to before a plunger is moved.
    several_heads : bool
        Whether that holds for a job of several heads, too.
    widest_push : bool
        Whether it refuses a move that pushes more ink per length than a limit of its own.
    """

    place: str
    remedy: str
    several_heads: bool = True
    widest_push: bool = False


# Record type of a firmware's serial abilities: its protocol, line pairing, resume, quick stop.


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


@dataclass(frozen=True)
class ProbeFacts:
    """Questions, none of which sets anything.

    Attributes
    ----------
    questions : tuple of bytes
    phrases : mapping of str to str
        Words before a number, and the profile's key for it, where it doesn't list its settings as
        the commands that would set them.
    """

    questions: tuple[bytes, ...] = ()
    phrases: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Family:
    """A firmware family: all in which it differs from others.

    Attributes
    ----------
    link : LinkFacts or None
        How a host speaks to it; None where a host sends it no lines.
    grammar : Grammar
        How it reads a line, and which commands it knows.
    dialect : callable
        What a job begins and ends with, for a printer's profile. Raises ProfileError where the
        profile doesn't say enough.
    gate : GateFacts
        What may be sent beyond what all take, and what is asked and reset before a start.
    probe : ProbeFacts
        What it is asked for its settings.
    timeout : IdleTimeout or None
        Its own switch-off, where a job can set it.
    cold : ColdExtrusion or None
        How it is told to push without a hot end; None where it always does.
    heads : HeadFacts or None
        How it changes between several heads; None where that isn't known.
    by_hand : ConfigurationFacts or None
        What a person must see to in its configuration.
    advance : bytes
        Pattern of the command that sets pressure advance, its group the value, s; empty for none.
    advances_across_only : bool
        Whether it advances the plunger in moves along x or y alone.
    file_controllers : mapping of str to str
        Controllers of the family, where they load a file and take no lines, and how the command
        begins that sets an output of each; empty for all others.
    """

    link: LinkFacts | None
    grammar: Grammar
    dialect: Callable[[Printer], Dialect]
    gate: GateFacts = field(default_factory=GateFacts)
    probe: ProbeFacts = field(default_factory=ProbeFacts)
    timeout: IdleTimeout | None = None
    cold: ColdExtrusion | None = None
    heads: HeadFacts | None = None
    by_hand: ConfigurationFacts | None = None
    advance: bytes = b""
    advances_across_only: bool = False
    file_controllers: Mapping[str, str] = field(default_factory=dict)


def m302_by_p(words: Mapping[str, float]) -> int:
    """Read an M302 by P alone: 1 allows, -1 forbids, 0 neither."""
    if "P" not in words:
        return 0
    return 1 if words["P"] > 0 else -1


SELECT_BY_T = re.compile(r"T([0-7])(?: [SP]\d)?")
"""T1 S1 (Marlin: no move), T1 P0 (RepRapFirmware: no macros)."""
