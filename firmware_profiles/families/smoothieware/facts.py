"""Smoothieware's family record: known codes, syntax, queries, resets; not verified on a board.

Sources: https://smoothieware.org/supported-g-codes, ``Robot.cpp``, ``GcodeDispatch.cpp``. No
timeout; it extrudes cold, and answers ok to what it doesn't know. What M220 and M221 have set it
doesn't tell, so it is reset.
"""

from __future__ import annotations

from typing import Final

from firmware_profiles.families.common_words import COMMON
from firmware_profiles.families.dialect import Dialect, same_dialect
from firmware_profiles.families.family import Family
from firmware_profiles.families.gate_facts import GateFacts
from firmware_profiles.families.grammar import Grammar, codes, number_range
from firmware_profiles.families.link_facts import LinkFacts, LinkSetup
from firmware_profiles.families.link_protocol import LinkProtocol
from firmware_profiles.families.probe_facts import ProbeFacts
from firmware_profiles.families.smoothieware.protocol import SmoothieProtocol

_CODES: Final = codes(
    "G",
    number_range(0, 4),
    10,
    11,
    number_range(17, 21),
    number_range(28, 32),
    38,
    43,
    number_range(53, 59),
    number_range(90, 92),
) | codes(
    "M",
    *(
        17,
        18,
        20,
        21,
        number_range(23, 27),
        30,
        32,
        number_range(82, 84),
        92,
        number_range(104, 107),
        109,
        110,
        112,
        114,
    ),
    *(
        115,
        117,
        119,
        120,
        121,
        140,
        190,
        200,
        number_range(203, 208),
        220,
        221,
        301,
        303,
        304,
        305,
        306,
    ),
    *(
        307,
        374,
        375,
        400,
        number_range(500, 504),
        557,
        561,
        565,
        600,
        601,
        665,
        666,
        670,
        907,
        911,
        999,
    ),
)
_ANY_WORD: Final = ("M18", "M84", "M92", "M105", "M114", "M201", "M203", "M204", "M220", "M221")


def _make_protocol(setup: LinkSetup) -> LinkProtocol:
    return SmoothieProtocol(setup.timing)


FAMILY: Final = Family(
    link=LinkFacts(says="smoothie", make_protocol=_make_protocol, remembers=True),
    grammar=Grammar(
        codes=_CODES,
        words={code: words for code, words in COMMON.items() if code not in _ANY_WORD},
        lower_case=False,
        powers_of_ten=True,
        rest_codes=codes("M", 117),
    ),
    dialect=same_dialect(Dialect()),
    gate=GateFacts(resets=("M220 S100", "M221 S100")),
    probe=ProbeFacts((b"M115", b"M503")),
)
