"""A firmware family's one record: serial link, commands, dialect, safety rules, heads."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from firmware_profiles.families.dialect import Dialect
from firmware_profiles.families.grammar import Grammar
from firmware_profiles.families.link_protocol import LinkProtocol, Places
from firmware_profiles.families.timing import Timing

if TYPE_CHECKING:
    from firmware_profiles.printers import Printer


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
    """Let a head pass that the printer has, named as `Family.head_select` says."""


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


def m302_by_p(words: Mapping[str, float]) -> int:
    """Read an M302 by P alone: 1 allows, -1 forbids, 0 neither."""
    if "P" not in words:
        return 0
    return 1 if words["P"] > 0 else -1


SELECT_BY_T = re.compile(r"T([0-7])(?: [SP]\d)?")
"""T1 S1 (Marlin: no move), T1 P0 (RepRapFirmware: no macros)."""


@dataclass(frozen=True, kw_only=True)
class Family:
    """A firmware family: all in which it differs from others.

    Attributes
    ----------
    grammar : Grammar
        How it reads a line, and which commands it knows.
    dialect : callable
        What a job begins and ends with, for a printer's profile. Raises ProfileError where the
        profile doesn't say enough.
    make_protocol : callable or None
        Makes the state machine that speaks to it; None where a host sends it no lines.
    reported_name : str
        What its FIRMWARE_NAME (M115) contains, in small letters.
    hosts : tuple of str
        Network hosts that run files on it (schemes of a port: ``moonraker``).
    verified : bool
        Whether a real one's transcripts were replayed against the state machine.
    keepalive : bool
        Whether it can be told to say that it is busy (M113).
    tells_steps : bool
        Whether M92 tells the steps per mm.
    stores_steps : bool
        Whether M92 sets the steps per mm and M500 stores them.
    steps_remedy : str
        Where a person sets the plunger's steps per mm of a family that doesn't; ``{steps}`` stands
        for them.
    remembers : bool
        Whether it can be asked which line it took last, so that a print can be resumed after the
        host died.
    pairs : bool
        Whether two lines may be in flight: it counts them, and that was tried.
    cuts_long_lines : bool
        Whether a line longer than the receive buffer is cut.
    m84_sets_timeout : bool
        Whether ``M84 S`` sets the time after which idle motors lose their power; else it takes
        the power at once, or does something else.
    plans_by_time : bool
        Whether it plans ahead by time, so that the number of moves under way is unknown.
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
        Longest time for which its motors go on after it has halted; 0 where unknown.
    quickstop : bytes
        Command that stops its motors at once, drops the moves that it holds and is answered when
        the position is counted from the motors' steps; with an emergency parser before its turn.
        Empty for none.
    ends_waits : bytes
        Command that ends a wait for heat before its turn, the target unchanged. Empty for none.
    console_rules, job_rules : mapping of str to Rule
        By code: what the console and a job may send beside what all families take.
    start_questions : tuple of str
        Asked before a start; none of it sets anything.
    start_resets : tuple of str
        Sent before a start because the firmware doesn't tell what is set.
    m203_per_s : float
        What M203 is given per: 1 for mm/s, 60 for mm/min.
    has_min_speed : bool
        Whether moves slower than the profile's ``min_speed_mm_s`` are done at that speed.
    least_steps_s : float, 1/s
        Steps of the axis with most below which an 8-bit board's move is done faster; 0 for none.
    awaits_cooling : frozenset of str
        Codes that wait until it has cooled to S, too, not only until it is as warm.
    setting_questions : tuple of bytes
        Questions for its settings, none of which sets anything.
    setting_phrases : mapping of str to str
        Words before a number, and the profile's key for it, where it doesn't list its settings as
        the commands that would set them.
    timeout_code, timeout_key, timeout_example : str
        Command of its own switch-off when the host is silent; the key of its seconds, where the
        command has a name, else empty for the word S; how it may be written, for a message. Empty
        where a job can't set it.
    cold_remedy : str
        What to do where it doesn't push without a hot end; empty where it always does.
    reads_m302 : callable
        What M302 with such words says: 1 allows cold extrusion, -1 forbids it, 0 neither.
    head_select : pattern or None
        Command that chooses one of several heads; its group is the head's number, empty for 0.
        None where that isn't known.
    head_example : str
        Such a command, for a message.
    head_confirms : callable
        How a line ends by which it says that it uses head ``number``, one of several ways; none
        where it says nothing.
    head_macro_free : str
        Word and number without which a choice of head may run macros that move; empty for none.
    head_offset_code, head_offset_word : str
        Command by which it is given a head's offset, and the word for the head; empty for none.
    head_offset_needs_word : bool
        Whether that command without the word is another one; else it is about the head in use.
    head_first_offset : int
        First head that can have an offset.
    head_note : str
        What to see to where the heads' steps differ; empty for nothing.
    full_output : float
        Number by which an output is all on: 255, or 1.
    configuration_file, configuration_remedy : str
        File of its configuration, and what a person must see to there before a plunger is moved,
        since no question tells it; empty for nothing.
    configured_heads : bool
        Whether that holds for a job of several heads, too.
    limits_push_width : bool
        Whether it refuses a move that pushes more ink per length than a limit of its own.
    advance : bytes
        Pattern of the command that sets pressure advance, its group the value, s; empty for none.
    advances_across_only : bool
        Whether it advances the plunger in moves along x or y alone.
    file_controllers : mapping of str to tuple of str
        Controllers of the family, where they load a file and take no lines, and how commands
        begin that set an output of each; empty for all others.
    setup_words : mapping of str to frozenset of str
        Of each of these controllers the words, in capitals, that may begin a lab's own line: none
        of them moves anything.
    """

    grammar: Grammar
    dialect: Callable[[Printer], Dialect]
    make_protocol: Callable[[LinkSetup], LinkProtocol] | None = None
    reported_name: str = ""
    hosts: tuple[str, ...] = ()
    verified: bool = False
    keepalive: bool = False
    tells_steps: bool = False
    stores_steps: bool = False
    steps_remedy: str = ""
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
    console_rules: Mapping[str, Rule] = field(default_factory=dict)
    job_rules: Mapping[str, Rule] = field(default_factory=dict)
    start_questions: tuple[str, ...] = ()
    start_resets: tuple[str, ...] = ()
    m203_per_s: float = 1.0
    has_min_speed: bool = False
    least_steps_s: float = 0.0
    awaits_cooling: frozenset[str] = frozenset()
    setting_questions: tuple[bytes, ...] = ()
    setting_phrases: Mapping[str, str] = field(default_factory=dict)
    timeout_code: str = ""
    timeout_key: str = ""
    timeout_example: str = ""
    cold_remedy: str = ""
    reads_m302: Callable[[Mapping[str, float]], int] = m302_by_p
    head_select: re.Pattern[str] | None = None
    head_example: str = ""
    head_confirms: Callable[[int], tuple[bytes, ...]] = lambda number: ()
    head_macro_free: str = ""
    head_offset_code: str = ""
    head_offset_word: str = ""
    head_offset_needs_word: bool = False
    head_first_offset: int = 0
    head_note: str = ""
    full_output: float = 255.0
    configuration_file: str = ""
    configuration_remedy: str = ""
    configured_heads: bool = True
    limits_push_width: bool = False
    advance: bytes = b""
    advances_across_only: bool = False
    file_controllers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    setup_words: Mapping[str, frozenset[str]] = field(default_factory=dict)

    def timeout_command(self, seconds: str) -> str:
        """Write the command that sets its own switch-off."""
        words = f"{self.timeout_key}={seconds}" if self.timeout_key else f"S{seconds}"
        return f"{self.timeout_code} {words}"

    def head_number(self, command: str) -> int | None:
        """Head that a command chooses; None for any other command."""
        match = self.head_select.fullmatch(command) if self.head_select else None
        return int(match[1] or 0) if match else None
