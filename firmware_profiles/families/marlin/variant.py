"""Variants of Marlin's protocol: the same numbers and checksums, other answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from firmware_profiles.families.marlin.doubt import QUESTION
from firmware_profiles.families.marlin.guarding import guarded
from firmware_profiles.families.marlin.replies import Reply, classify
from firmware_profiles.families.marlin.tokens import Tokens


@dataclass(frozen=True)
class Variant:
    """What a firmware has otherwise; Marlin's own without arguments.

    Attributes
    ----------
    kill_bytes : bytes
        What halts it at once, out of band.
    question : bytes
        What asks which line it took last.
    two_resends : bool
        Whether the answer to that is twice the same ``Resend``, without "Last Line".
    classify : callable
        Reads a line from the printer.
    guard : callable
        Makes a command safe from a flipped bit.
    make_tokens : type of Tokens
    """

    kill_bytes: bytes = b"\nM112\n"
    question: bytes = QUESTION
    two_resends: bool = False
    classify: Callable[[bytes], Reply] = classify
    guard: Callable[[bytes], bytes] = guarded
    make_tokens: type[Tokens] = Tokens
