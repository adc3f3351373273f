"""RepRapFirmware's family record: syntax, dialect, queries, heads; not verified on a board.

Sources: RepRapFirmware 3.5 ``GCodes2.cpp`` (M302 P1 as Marlin's; M85 is taken and does nothing, M84
S lowers the idle motors' current only; M203 in mm/min; G92 X Y Z makes the axes count as homed,
``GCodes::SetPositions``; ``StringParser.cpp``: a G or M outside of quotes begins another command of
the line, but in the text without quotes of M23, M28, M30, M32, M36 and M117; a text that begins
with a brace is an expression, behind which the line goes on with the next command; M220 and M221
answer a number and ``%``); docs.duet3d.com (M572, G10 P, M114, M669).
"""

from __future__ import annotations

from typing import Final

from firmware_profiles.families.dialect import Dialect, same_dialect
from firmware_profiles.families.family import Family
from firmware_profiles.families.gate_facts import AllowOffsetReset, AllowQuery, GateFacts
from firmware_profiles.families.grammar import Grammar, codes
from firmware_profiles.families.job_facts import (
    SELECT_BY_T,
    ColdExtrusion,
    ConfigurationFacts,
    HeadFacts,
    m302_by_p,
)
from firmware_profiles.families.link_facts import LinkFacts, LinkSetup
from firmware_profiles.families.link_protocol import LinkProtocol
from firmware_profiles.families.probe_facts import ProbeFacts
from firmware_profiles.families.reprapfirmware.codes import CODES, WORDS
from firmware_profiles.families.reprapfirmware.protocol import RrfProtocol


def _make_protocol(setup: LinkSetup) -> LinkProtocol:
    return RrfProtocol(setup.places, setup.timing)


FAMILY: Final = Family(
    link=LinkFacts(
        says="reprapfirmware",
        make_protocol=_make_protocol,
        tells_steps=True,
        axes_question=b"M669",
    ),
    grammar=Grammar(
        codes=CODES,
        words=WORDS,
        quoted_words=True,
        crc16=True,
        powers_of_ten=True,
        rest_codes=codes("M", 23, 28, 30, 32, 36, 117),
        expressions=True,
        e_rule="alone",
    ),
    dialect=same_dialect(
        Dialect(
            cold_extrusion="M302 P1", of_each_head=("G10 P{head} X0 Y0 Z0", "M221 D{head} S100")
        )
    ),
    gate=GateFacts(
        console={
            **dict.fromkeys(("M208", "M290", "M408", "M564", "M566", "M572"), AllowQuery()),
            "M409": AllowQuery("KF"),
        },
        job={"G10": AllowOffsetReset("P")},
        questions=("M220", "M221", "M564", "M290"),
        speed_per_s=60.0,
    ),
    probe=ProbeFacts((b"M115", b"M92", b"M201", b"M203", b"M208", b"M302")),
    cold=ColdExtrusion("send M302 P1 before", m302_by_p),
    heads=HeadFacts(
        select=SELECT_BY_T,
        example="T1",
        macro_free="P0",
        offset_code="G10",
        offset_word="P",
        offset_needs_word=True,
    ),
    by_hand=ConfigurationFacts(
        "config.g",
        "a tool must be selected (T0), else the board refuses to push; the job selects none, "
        "since that may run macros that move; see that it is",
        several_heads=False,  # such a job chooses one itself, without its macros
    ),
    advance=rb"M572\b[^;]*?S\s*([0-9.]+)",
)
