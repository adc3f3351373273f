"""Kinds of check results, by which programs recognise them; their texts are for people."""

from __future__ import annotations

from enum import StrEnum, unique


@unique
class Kind(StrEnum):
    """What a check looked at; the value stands in JSON and is stable.

    Of several heads, wells or axes each has a check of the same kind.
    """

    # the file as it is read
    BAD_LINE = "bad_line"
    CUT_OFF = "cut_off"
    EMPTY_FILE = "empty_file"
    FORBIDDEN_COMMAND = "forbidden_command"
    IDLE_E = "idle_e"
    LINE_LENGTH = "line_length"
    NO_COMMAND = "no_command"
    OUTPUTS = "outputs"
    START = "start"
    UNKNOWN_COMMAND = "unknown_command"
    # motion
    ARC = "bad_arc"
    COLD_EXTRUSION = "cold_extrusion"
    HOMING = "homing"
    LEFT_DOWN = "left_down"
    MERGED_MOVES = "merged_moves"
    MOTORS_OFF = "motors_off"
    PLACE_REDEFINED = "place_redefined"
    PLUNGER_BEHIND = "plunger_behind"
    PLUNGER_TRAVEL = "plunger_travel"
    PROBING = "probing"
    SPEED = "speed"
    STARVED = "starved"
    STEPS = "steps"
    TOO_SLOW = "too_slow"
    TRAVEL = "travel"
    # firmware
    ASKED = "asked"
    ENDLESS_WAIT = "endless_wait"
    SAFE_STATE = "safe_state"
    SWITCH_OFF = "switch_off"
    WATCH = "watch"
    # heads and valves
    HEAD_NOT_CHOSEN = "head_not_chosen"
    HEAD_OFFSET_TWICE = "offset_twice"
    HEAD_OFFSET_UNKNOWN = "offset_unknown"
    HEAD_STATE = "head_state"
    IDLE_HEAD = "idle_head"
    NO_SUCH_HEAD = "no_such_head"
    PLUNGER_NOT_COUNTED = "plunger_not_counted"
    SET_PRESSURE = "set_pressure"
    VALVE = "valve"
    # parts
    INK_LEFT = "ink_left"
    MADE_FOR = "made_for"
    OTHER_PART = "other_part"
    PROFILE = "profile"
    UNKNOWN_PART = "unknown_part"
    UNRECORDED = "unrecorded"
    # the machine and who prints
    CHECKLIST = "checklist"
    CONTROLS = "controls"
    JOB = "job"
    OPERATOR = "operator"
    PRINTER = "printer"
    TIP = "tip"
    TOUCH_OFF = "touch_off"
    # dish and bath
    BATH_DEPTH = "bath_depth"
    BATH_SURFACE = "bath_surface"
    BATH_TEMPERATURE = "bath_temperature"
    CHEMISTRY = "chemistry"
    FILAMENT_HELD = "filament_held"
    FLOOR = "floor"
    HUB = "hub"
    MELT_OUT = "melt_out"
    NEEDLE_LENGTH = "needle_length"
    ROLE = "role"
    WALL = "wall"
    # ink
    BEAD_WIDTH = "bead_width"
    DROP = "drop"
    FLOW = "flow"
    HELD_PRESSURE = "held_pressure"
    INK_TEMPERATURE = "ink_temperature"
    PLUNGER_FORCE = "plunger_force"
    PRESSURE = "pressure"
    RELOAD_TIME = "reload_time"
    SHEAR_STRESS = "shear_stress"
    SYRINGE_VOLUME = "syringe_volume"
    VALVE_INK = "valve_ink"
    VIABILITY = "viability"
    WRITING_SPEED = "writing_speed"
    # vessels that the needle's shaft meets
    SHAFT_CROSSING = "shaft_crossing"
    SHAFT_NEAR = "shaft_near"
    SHAFT_UNMAPPED = "shaft_unmapped"
    # a plate
    PLATE_PLACE = "plate_place"
    WELL_ENTERED = "well_entered"
    WELL_MOVES = "well_moves"
    WELL_RIMS = "well_rims"
