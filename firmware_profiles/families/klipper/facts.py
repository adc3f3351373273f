"""Klipper's family record: dialect, allowed extra commands, queries, resets, idle timeout, heads.

Sources: ``idle_timeout.py``, ``force_move.py``, ``gcode_move.py``, ``kinematics/extruder.py``,
``toolhead.py``, docs/Kinematics.md (pressure advance).

- SET_IDLE_TIMEOUT sets its own switch-off.
- Cold extrusion is allowed in printer.cfg alone (``min_extrude_temp``).
- G92 X Y Z moves the origin and homes nothing; SET_KINEMATIC_POSITION (section ``force_move``) says
  where the tip is. SET_GCODE_OFFSET adds to every place until it is set to 0. M200 isn't known.
- ACTIVATE_EXTRUDER has no offset; a macro named T0 may have.
- M109 and M190 wait until a heater under PID control has settled (``heaters.py``): cooling, too.
- M400 is answered by the host's clock: for up to 5 s also where the micro-controller is dead. M119
  waits for the last move, and for the micro-controller's own answer (``query_endstops.py``).
- GET_POSITION tells places and what they are shifted by without waiting for the motors.
- What M220 and M221 have set it doesn't tell, so it is reset.
- SET_VELOCITY_LIMIT, SET_IDLE_TIMEOUT and SET_PRESSURE_ADVANCE without words answer their present
  values; its steps, limits and min_extrude_temp it doesn't tell on its terminal.
"""

from __future__ import annotations

import re
from typing import Final

from firmware_profiles.families.dialect import Dialect, same_dialect
from firmware_profiles.families.family import (
    Advance,
    AllowQuery,
    AllowValues,
    CheckNamedHeater,
    ChooseHead,
    Family,
    Keys,
    LinkSetup,
    Rule,
    Timeout,
)
from firmware_profiles.families.grammar import MOVE, TEXTS, Grammar, Meaning, codes, number_range
from firmware_profiles.families.klipper.protocol import KlipperProtocol
from firmware_profiles.families.link_protocol import LinkProtocol

_CLEAN: Final = ("M220 S100", "M221 S100", "SET_GCODE_OFFSET X=0 Y=0 Z=0")
_HEATERS: Final = {"extruder": "nozzle", "heater_bed": "bed"}
_HEAT: Final = CheckNamedHeater("HEATER", _HEATERS, "extruder", ("TARGET",))
_AWAIT: Final = CheckNamedHeater("SENSOR", _HEATERS, "extruder", ("MINIMUM", "MAXIMUM"))
_ASKED: Final[dict[str, Rule]] = {
    "GET_POSITION": AllowQuery(),
    "STATUS": AllowQuery(),
    "SET_VELOCITY_LIMIT": AllowQuery(),
    "SET_PRESSURE_ADVANCE": AllowQuery(),
    "TURN_OFF_HEATERS": AllowQuery(),
    "SET_HEATER_TEMPERATURE": _HEAT,
}


def _make_protocol(setup: LinkSetup) -> LinkProtocol:
    return KlipperProtocol(setup.places, setup.timing)


def _confirms(number: int) -> tuple[bytes, ...]:
    name = b"extruder%b" % (b"%d" % number if number else b"")
    return b"Activating extruder " + name, b"Extruder %b already active" % name


# ``gcode.py``, ``gcode_move.py``, ``toolhead.py``, ``extruder.py``, ``heaters.py``, ``fan.py`` and
# docs/G-Codes.md: what a printer.cfg with an extruder, a bed and a fan gives. Macros and commands
# of other sections are the machine's own.
CODES: Final = codes("G", 0, 1, 4, 21, 28, 90, 91, 92) | codes(
    "M",
    18,
    82,
    83,
    84,
    number_range(104, 107),
    109,
    110,
    112,
    114,
    115,
    119,
    140,
    190,
    204,
    220,
    221,
    400,
)
NAMES: Final[dict[str, Meaning]] = {
    **dict.fromkeys(
        (
            "GET_POSITION",
            "RESTORE_GCODE_STATE",
            "SAVE_GCODE_STATE",
            "SET_FAN_SPEED",
            "SET_IDLE_TIMEOUT",
            "SET_PIN",
            "SET_PRESSURE_ADVANCE",
            "SET_VELOCITY_LIMIT",
            "STATUS",
            "TURN_OFF_HEATERS",
        ),
        Meaning.OTHER,
    ),
    "ACTIVATE_EXTRUDER": Meaning.CHOOSES,
    "SET_GCODE_OFFSET": Meaning.SHIFTS,
    "SET_HEATER_TEMPERATURE": Meaning.HEATS,
    "SET_KINEMATIC_POSITION": Meaning.PLACES,
    "TEMPERATURE_WAIT": Meaning.AWAITS,
}
WORDS: Final[dict[str, str]] = {
    **TEXTS,
    "G0": MOVE,
    "G1": MOVE,
    "G2": "X Y Z E F I J",
    "G3": "X Y Z E F I J",
    "G4": "P",
    "G20": "",
    "G21": "",
    "G28": "X? Y? Z?",
    "G90": "",
    "G91": "",
    "G92": "X Y Z E",
    "M18": "",
    "M82": "",
    "M83": "",
    "M84": "",
    "M104": "S T",
    "M105": "",
    "M106": "P S",
    "M107": "P",
    "M109": "S T",
    "M110": "N",
    "M112": "",
    "M114": "",
    "M115": "",
    "M119": "",
    "M140": "S",
    "M190": "S",
    "M204": "S P T",
    "M220": "S",
    "M221": "S",
    "M400": "",
}
FAMILY: Final = Family(
    reported_name="klipper",
    hosts=("moonraker", "octoprint"),
    make_protocol=_make_protocol,
    plans_by_time=True,
    complains_to_all=True,
    place_question=b"GET_POSITION",
    rest_question=b"M119",
    grammar=Grammar(
        codes=CODES, names=NAMES, words=WORDS, named=True, parentheses=False, e_rule="either"
    ),
    dialect=same_dialect(
        Dialect(
            "SET_IDLE_TIMEOUT TIMEOUT={seconds}",
            clean=_CLEAN,
            declares="SET_KINEMATIC_POSITION X={x} Y={y} Z={z}",
            zero_is_off=False,
        )
    ),
    console_rules=_ASKED,
    job_rules={
        **_ASKED,
        "ACTIVATE_EXTRUDER": ChooseHead(),
        "SET_FAN_SPEED": Keys({"FAN": None, "SPEED": (0, 1)}, ("FAN", "SPEED")),
        "SET_GCODE_OFFSET": AllowValues({"X": 0, "Y": 0, "Z": 0}, "write the places themselves"),
        "SET_IDLE_TIMEOUT": Timeout("TIMEOUT"),
        "SET_KINEMATIC_POSITION": Keys(dict.fromkeys("XYZ", (-1e6, 1e6))),
        "SET_PRESSURE_ADVANCE": Advance("ADVANCE"),
        "TEMPERATURE_WAIT": _AWAIT,
    },
    start_questions=("SET_IDLE_TIMEOUT", "GET_POSITION"),
    start_resets=_CLEAN,
    awaits_cooling=frozenset({"M109", "M190"}),
    steps_remedy="put rotation_distance = full_steps_per_rotation × microsteps / {steps} into the "
    "extruder's section of printer.cfg, then RESTART",
    setting_questions=(
        b"M115",
        b"SET_VELOCITY_LIMIT",
        b"SET_IDLE_TIMEOUT",
        b"SET_PRESSURE_ADVANCE",
    ),
    setting_phrases={
        "max_accel": "acceleration_mm_s2",
        "idle_timeout: Timeout set to": "idle_timeout_s",
    },
    timeout_code="SET_IDLE_TIMEOUT",
    timeout_key="TIMEOUT",
    timeout_example="SET_IDLE_TIMEOUT",
    cold_remedy=(
        "set min_extrude_temp to 0 in printer.cfg (extruder), then "
        "cold_extrusion_configured in the profile: no command does it"
    ),
    head_select=re.compile(r"ACTIVATE_EXTRUDER EXTRUDER=extruder([1-7]?)"),
    head_example="ACTIVATE_EXTRUDER EXTRUDER=extruder1",
    head_confirms=_confirms,
    full_output=1.0,
    configuration_file="printer.cfg",
    configuration_remedy=(
        "min_extrude_temp must be 0 (section extruder), and the section force_move must be "
        "there with enable_force_move, else it refuses the first move; see that they are"
    ),
    limits_push_width=True,
    advance=rb"SET_PRESSURE_ADVANCE\b[^;]*?\bADVANCE=([0-9.]+)",
    advances_across_only=True,
)
