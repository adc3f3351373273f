"""Record type of a firmware family: serial link, known commands, dialect, safety rules, heads."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from firmware_profiles.families.dialect import Dialect
from firmware_profiles.families.gate_facts import GateFacts
from firmware_profiles.families.grammar import Grammar
from firmware_profiles.families.job_facts import (
    ColdExtrusion,
    ConfigurationFacts,
    HeadFacts,
    IdleTimeout,
)
from firmware_profiles.families.link_facts import LinkFacts
from firmware_profiles.families.probe_facts import ProbeFacts

if TYPE_CHECKING:
    from firmware_profiles.printers import Printer


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
