"""Marlin's family record: protocol, codes, dialect, pre-job queries, idle timeout, heads.

Sources: https://marlinfw.org/meta/gcode/ (M85, M302, M900, M218); the recorded bugfix-2.1.x (M503
S0, M211, M220: ``FR:100%``, M221: ``E0 Flow: 100%``, M111: ``DEBUG:DRYRUN``, M302 ``Cold extrudes
are disabled (min temp 170C)``, M85 ``Inactivity timeout 600 s.``).

Motors after a kill: it leaves its step interrupts on, so that its words get out, and what the
planner holds goes on being made. Measured on bugfix-2.1.x: 0.47 to 0.67 s.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from firmware_profiles.families.dialect import Dialect, same_dialect
from firmware_profiles.families.family import (
    SELECT_BY_T,
    Family,
    LinkSetup,
    m302_by_p,
)
from firmware_profiles.families.grammar import COMMON, Grammar, codes, number_range
from firmware_profiles.families.link_protocol import LinkProtocol
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.pairing import Pairing

ADVANCE: Final = rb"M900\b[^;]*?K\s*([0-9.]+)"
RUN_ON_S: Final = 0.635
QUICKSTOP: Final = b"M410"


def make_protocol(setup: LinkSetup) -> LinkProtocol:
    """Make the state machine, with one line in flight or two."""
    pairing = Pairing(setup.receive_buffer_bytes, setup.withholds)
    return MarlinProtocol(setup.timing, pairing if setup.lines_in_flight == 2 else None)


def _m302(words: Mapping[str, float]) -> int:
    if "P" not in words and "S" in words:
        return 1 if words["S"] == 0 else -1
    return m302_by_p(words)


# After the recorded build (`tests/sim/data/marlin`); what isn't here is an unknown command. A
# stock build knows no inches (G20: INCH_MODE_SUPPORT); the profile of one that does names it
# (`extra_commands`). Words: Marlin bugfix-2.1.x ``src/gcode/**`` and marlinfw.org/meta/gcode.
CODES: Final = codes("G", number_range(0, 4), 21, 28, 90, 91, 92) | codes(
    "M",
    *(
        0,
        1,
        17,
        18,
        31,
        75,
        76,
        77,
        number_range(81, 85),
        92,
        number_range(104, 115),
        number_range(117, 121),
    ),
    *(140, 154, 155, 190, 200, 201, number_range(203, 206), 211, 220, 221, 301, 302, 400, 410, 428),
    *(number_range(500, 504), 876, 999),
)
WORDS: Final[dict[str, str]] = {
    **COMMON,
    "M31": "",
    "M76": "",
    "M77": "",
    "M81": "S?",
    "M111": "S",
    "M113": "S",
    "M120": "",
    "M121": "",
    "M154": "S",
    "M155": "S",
    "M200": "D S T L",
    "M205": "X Y Z E B J S T",
    "M206": "X Y Z",
    "M211": "S",
    "M218": "T X Y Z",
    "M220": "S B? R?",
    "M301": "P I D C L F E",
    "M428": "",
    "M500": "",
    "M501": "",
    "M502": "",
    "M503": "S C?",
    "M504": "",
    "M876": "P S",
    **{f"T{number}": "F S" for number in range(8)},
}
WHOLE: Final = frozenset({"M220", "M221"})
FAMILY: Final = Family(
    reported_name="marlin",
    hosts=("octoprint",),
    make_protocol=make_protocol,
    verified=True,
    keepalive=True,
    tells_steps=True,
    least_steps_s=32.0,
    remembers=True,
    pairs=True,
    cuts_long_lines=True,
    m84_sets_timeout=True,
    run_on_s=RUN_ON_S,
    quickstop=QUICKSTOP,
    ends_waits=b"M108",
    grammar=Grammar(codes=CODES, head_codes=frozenset({"M218"}), words=WORDS, whole=WHOLE),
    dialect=same_dialect(
        Dialect(
            "M85 S{seconds}",
            "M302 P1",
            of_others=("M218 T{head} X0 Y0 Z0", "M221 T{head} S100", "M200 T{head} D0"),
        )
    ),
    start_questions=("M503 S0", "M211", "M220", "M221", "M111", "M302", "M85"),
    stores_steps=True,
    setting_questions=(b"M115", b"M503", b"M211"),
    timeout_code="M85",
    timeout_example="M85 S600",
    cold_remedy="send M302 P1 before",
    reads_m302=_m302,
    head_select=SELECT_BY_T,
    head_example="T1",
    head_confirms=lambda number: (b"Active Extruder: %d" % number,),
    head_offset_code="M218",
    head_offset_word="T",
    head_first_offset=1,
    head_note="Marlin keeps steps for each only if it was built with DISTINCT_E_FACTORS",
    advance=ADVANCE,
)
"""Lower case is read where it was built so (GCODE_CASE_INSENSITIVE); what is sent is in capitals.
An offset of the first head's is none: the others' are counted from it."""
