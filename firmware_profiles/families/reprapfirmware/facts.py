"""RepRapFirmware's family record: syntax, dialect, queries, heads; not verified on a board.

Sources: RepRapFirmware 3.5 ``GCodes2.cpp`` (M302 P1 as Marlin's; M85 is taken and does nothing, M84
S lowers the idle motors' current only; M203 in mm/min; G92 X Y Z makes the axes count as homed,
``GCodes::SetPositions``; ``StringParser.cpp``: a G or M outside of quotes begins another command of
the line, but in the text without quotes of M23, M28, M30, M32, M36 and M117; a text that begins
with a brace is an expression, behind which the line goes on with the next command; M220 and M221
answer a number and ``%``); docs.duet3d.com (M572, G10 P, M114, M669).
"""

from __future__ import annotations

from binascii import crc_hqx
from typing import Final

from firmware_profiles.families.ack_protocol import AckProtocol, Sort
from firmware_profiles.families.dialect import Dialect, same_dialect
from firmware_profiles.families.family import (
    SELECT_BY_T,
    AllowOffsetReset,
    AllowQuery,
    Family,
    LinkSetup,
)
from firmware_profiles.families.grammar import COMMON, Grammar, codes, number_range
from firmware_profiles.families.known_messages import load_messages
from firmware_profiles.families.link_protocol import LinkProtocol


def _make_protocol(setup: LinkSetup) -> LinkProtocol:
    return RrfProtocol(setup.places, setup.timing)


# Every ``case`` of ``GCodes2.cpp`` (3.5) but M667, which it refuses; a macro file of a command's
# name makes it known, too. Words: 3.x ``GCodes*.cpp``.
CODES: Final = codes(
    "G",
    number_range(0, 4),
    10,
    11,
    number_range(17, 21),
    number_range(28, 32),
    38,
    number_range(53, 60),
    68,
    69,
    number_range(90, 94),
) | codes(
    "M",
    *(
        number_range(0, 5),
        17,
        18,
        number_range(20, 30),
        32,
        number_range(36, 39),
        42,
        73,
        number_range(80, 85),
        92,
        98,
        99,
    ),
    *(number_range(101, 112), number_range(114, 122), 140, 141, 143, 144, 150, 190, 191, 200, 201),
    *(
        number_range(203, 208),
        220,
        221,
        226,
        260,
        261,
        280,
        number_range(290, 292),
        number_range(300, 304),
        number_range(307, 309),
    ),
    *(
        350,
        number_range(374, 376),
        number_range(400, 402),
        404,
        number_range(407, 409),
        425,
        number_range(450, 453),
        470,
        471,
        486,
    ),
    *(
        number_range(500, 503),
        505,
        540,
        number_range(550, 572),
        number_range(574, 577),
        579,
        581,
        582,
        number_range(584, 589),
    ),
    *(
        number_range(591, 601),
        665,
        666,
        number_range(669, 673),
        675,
        number_range(701, 703),
        851,
        905,
        906,
        911,
        912,
        913,
    ),
    *(number_range(915, 918), 929, number_range(950, 957), number_range(997, 999)),
)
_ANY_WORD: Final = ("M18", "M84", "M92", "M115", "M201", "M203", "M220", "M204")
WORDS: Final[dict[str, str]] = {
    **{code: words for code, words in COMMON.items() if code not in _ANY_WORD},
    "M106": "P S I F L X B H R T C?",
    "M109": "S R T P",
    "M110": "N",
    "M114": "",
    "M140": "P S R H",
    "M190": "P S R H",
    "M221": "S D",
    "M302": "P S R",
    "M400": "S P",
    "M999": "B P? A?",
    **{f"T{number}": "P" for number in range(8)},
}
FAMILY: Final = Family(
    reported_name="reprapfirmware",
    hosts=("duet", "octoprint"),
    make_protocol=_make_protocol,
    tells_steps=True,
    axes_question=b"M669",
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
    console_rules={
        **dict.fromkeys(("M208", "M290", "M408", "M564", "M566", "M572"), AllowQuery()),
        "M409": AllowQuery("KF"),
    },
    job_rules={"G10": AllowOffsetReset("P")},
    start_questions=("M201", "M203", "M220", "M221", "M564", "M290"),
    m203_per_s=60.0,
    has_min_speed=True,  # DDA::InitStandardMove; DefaultMinFeedrate of Configuration.h
    steps_remedy="put M92 E{steps} into config.g, then restart the board",
    setting_questions=(b"M115", b"M92", b"M201", b"M203", b"M208", b"M302"),
    cold_remedy="send M302 P1 before",
    head_select=SELECT_BY_T,
    head_example="T1",
    head_macro_free="P0",
    head_offset_code="G10",
    head_offset_word="P",
    head_offset_needs_word=True,
    full_output=1.0,
    configuration_file="config.g",
    configuration_remedy=(
        "a tool must be selected (T0), else the board refuses to push; the job selects none, "
        "since that may run macros that move; see that it is"
    ),
    configured_heads=False,  # such a job chooses one itself, without its macros
    advance=rb"M572\b[^;]*?S\s*([0-9.]+)",
)


class RrfProtocol(AckProtocol):
    """See the module.

    Facts (RepRapFirmware `StringParser.cpp`, 3.x): with ``N`` in front a line is checked, by an XOR
    of one to three digits or a CRC-16 of five; one that fails is dropped without a word, neither ok
    nor resend; the order of numbers isn't looked at, so that a line sent twice is done twice. The
    line number that M409 tells is stored before the check, so it is no evidence of what was done.

    The five digits of the CRC-16 find what the XOR lets through. A line cut in two by noise is done
    half by half, unless the board is told to want a checksum (M575 P0 S1); USB has a CRC of its
    own.
    """

    messages = load_messages("reprapfirmware")
    error_starts = (b"Error:", b"Warning:", b"Emergency Stop", b"Printer halted")

    def frame(self, number: int, command: bytes) -> bytes:
        """``N<number> <command>*<CRC-16 in five digits>`` and line end."""
        body = b"N%d %b" % (number, command)
        return b"%b*%05d\n" % (body, crc16(body))

    def sort(self, text: bytes) -> Sort:
        """Tell what a line from the printer is."""
        return self.sort_known(text)


def crc16(data: bytes) -> int:
    """CRC-16/XMODEM of ``data``; 0x31C3 for ``b"123456789"``."""
    return crc_hqx(data, 0)
