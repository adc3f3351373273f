"""Prusa-Firmware's family record: Marlin's with codes added and missing; not verified on a board.

Source: ``Marlin_main.cpp``. M85 as Marlin's; M302 knows S alone, 0 where it isn't given.
It isn't known to have M410, and the time for which
its motors go on after a kill is taken from Marlin, longer than its own if that ends them at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from firmware_profiles.families.dialect import Dialect, same_dialect
from firmware_profiles.families.family import (
    Family,
)
from firmware_profiles.families.grammar import Grammar, codes
from firmware_profiles.families.marlin import facts as marlins
from firmware_profiles.families.marlin.facts import (
    ADVANCE,
    RUN_ON_S,
    make_protocol,
)

_MISSING: Final = codes("M", 113, 154, 428, 876)
_OWN: Final = codes("G", 10, 11, 80) | codes("M", 42, 73, 80, 81, 201, 207, 226, 300, 600, 900)


def _m302(words: Mapping[str, float]) -> int:
    return 1 if words.get("S", 0.0) == 0 else -1


FAMILY: Final = Family(
    reported_name="prusa",
    hosts=("octoprint",),
    make_protocol=make_protocol,
    keepalive=True,
    tells_steps=True,
    least_steps_s=32.0,
    remembers=True,
    pairs=True,
    cuts_long_lines=True,
    m84_sets_timeout=True,
    run_on_s=RUN_ON_S,
    grammar=Grammar(
        codes=(marlins.CODES - _MISSING) | _OWN,
        words={**marlins.WORDS, "G28": "X? Y? Z? W?", "M113": "S"},
        whole=marlins.WHOLE,
        lower_case=False,
        e_rule="alone",
    ),
    dialect=same_dialect(Dialect("M85 S{seconds}", "M302 S0")),
    start_questions=("M503 S0", "M211", "M220", "M221", "M111"),
    stores_steps=True,
    setting_questions=(b"M115", b"M503", b"M211"),
    timeout_code="M85",
    timeout_example="M85 S600",
    cold_remedy="send M302 S0 before",
    reads_m302=_m302,
    advance=ADVANCE,
)
