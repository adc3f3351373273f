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
from firmware_profiles.families.family import Family
from firmware_profiles.families.gate_facts import GateFacts
from firmware_profiles.families.grammar import Grammar
from firmware_profiles.families.job_facts import (
    SELECT_BY_T,
    ColdExtrusion,
    HeadFacts,
    IdleTimeout,
    m302_by_p,
)
from firmware_profiles.families.link_facts import LinkFacts, LinkSetup
from firmware_profiles.families.link_protocol import LinkProtocol
from firmware_profiles.families.marlin.codes import CODES, WHOLE, WORDS
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.pairing import Pairing
from firmware_profiles.families.probe_facts import ProbeFacts

ADVANCE: Final = rb"M900\b[^;]*?K\s*([0-9.]+)"
RUN_ON_S: Final = 0.635
QUICKSTOP: Final = b"M410"
TIMEOUT: Final = IdleTimeout("M85", "", "M85 S600")


def make_protocol(setup: LinkSetup) -> LinkProtocol:
    """Make the state machine, with one line in flight or two."""
    pairing = Pairing(setup.receive_buffer_bytes, setup.withholds)
    return MarlinProtocol(setup.timing, pairing if setup.lines_in_flight == 2 else None)


def _m302(words: Mapping[str, float]) -> int:
    if "P" not in words and "S" in words:
        return 1 if words["S"] == 0 else -1
    return m302_by_p(words)


FAMILY: Final = Family(
    link=LinkFacts(
        says="marlin",
        make_protocol=make_protocol,
        verified=True,
        keepalive=True,
        tells_steps=True,
        remembers=True,
        pairs=True,
        cuts_long_lines=True,
        m84_sets_timeout=True,
        run_on_s=RUN_ON_S,
        quickstop=QUICKSTOP,
        ends_waits=b"M108",
    ),
    grammar=Grammar(codes=CODES, head_codes=frozenset({"M218"}), words=WORDS, whole=WHOLE),
    dialect=same_dialect(
        Dialect(
            "M85 S{seconds}",
            "M302 P1",
            of_others=("M218 T{head} X0 Y0 Z0", "M221 T{head} S100", "M200 T{head} D0"),
        )
    ),
    gate=GateFacts(questions=("M503 S0", "M211", "M220", "M221", "M111", "M302", "M85")),
    probe=ProbeFacts((b"M115", b"M503", b"M211")),
    timeout=TIMEOUT,
    cold=ColdExtrusion("send M302 P1 before", _m302),
    heads=HeadFacts(
        select=SELECT_BY_T,
        example="T1",
        confirms=lambda number: (b"Active Extruder: %d" % number,),
        offset_code="M218",
        offset_word="T",
        first_offset=1,
        note="Marlin keeps steps for each only if it was built with DISTINCT_E_FACTORS",
    ),
    advance=ADVANCE,
)
"""Lower case is read where it was built so (GCODE_CASE_INSENSITIVE); what is sent is in capitals.
An offset of the first head's is none: the others' are counted from it."""
