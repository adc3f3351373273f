"""Data class of a finding of `printctl doctor`: problem of this computer, and its remedy."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """What is wrong and what to do.

    Attributes
    ----------
    text : str
    blocks : bool
        Whether printctl can't work on this machine until it is mended.
    """

    text: str
    blocks: bool = False
