"""Per-firmware rules for the command filter: extra codes allowed, pre-job queries and resets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


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
