"""Refuse a print with a printer or material profile that contradicts itself."""

from __future__ import annotations

from firmware_profiles import Facts, profile_doubts
from printctl.checks.set_up.check import Check


def profile_checks(*profiles: Facts) -> list[Check]:
    """A refusal for each grave doubt about a profile; nothing for one that is in order."""
    return [
        Check(
            f"profile {facts.name}",
            0,
            0,
            "",
            False,
            doubt.key,
            f"{doubt.text}; `printctl profiles check` tells all that is wrong with it",
        )
        for facts in profiles
        for doubt in profile_doubts(facts)
        if doubt.grave
    ]
