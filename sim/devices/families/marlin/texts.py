"""Long replies of a real Marlin build (`tests/sim/data/marlin`): M115 and boot banner.

The settings' image in the EEPROM isn't modelled: its size and CRC are those of the recorded build.
"""

from __future__ import annotations

from typing import Final

from firmware_profiles import Printer

UUID: Final = "cede2a2f-41a2-4748-9b12-c55c62f367ff"
SETTINGS: Final = "597 bytes; crc 27963"

_CAPABILITIES: Final = """
SERIAL_XON_XOFF:0 BINARY_FILE_TRANSFER:0 EEPROM:1 VOLUMETRIC:1 AUTOREPORT_POS:1 AUTOREPORT_TEMP:1
PROGRESS:0 PRINT_JOB:1 AUTOLEVEL:0 RUNOUT:0 Z_PROBE:0 LEVELING_DATA:0 BUILD_PERCENT:0
SOFTWARE_POWER:0 TOGGLE_LIGHTS:0 CASE_LIGHT_BRIGHTNESS:0 EMERGENCY_PARSER:{emergency}
HOST_ACTION_COMMANDS:1 PROMPT_SUPPORT:1 SDCARD:0 REPEAT:0 SD_WRITE:0 AUTOREPORT_SD_STATUS:0
LONG_FILENAME:0 LFN_WRITE:0 CUSTOM_FIRMWARE_UPLOAD:0 EXTENDED_M20:0 THERMAL_PROTECTION:1
MOTION_MODES:0 ARCS:1 BABYSTEPPING:0 EP_BABYSTEP:0 CHAMBER_TEMPERATURE:0 COOLER_TEMPERATURE:0
MEATPACK:0 CONFIG_EXPORT:0
"""


def _corner(printer: Printer, end: str) -> str:
    values = (getattr(span, end) for span in (printer.x_mm, printer.y_mm, printer.z_mm))
    return "{" + ",".join(f"{a}:{v:.2f}" for a, v in zip("xyz", values, strict=True)) + "}"


def identity(printer: Printer) -> list[str]:
    """Lines of M115, without the ok."""
    box = f"{{min:{_corner(printer, 'low')},max:{_corner(printer, 'high')}}}"
    return [
        "FIRMWARE_NAME:Marlin bugfix-2.1.x (Nov 20 2026 03:35:05) "
        "SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin PROTOCOL_VERSION:1.0 "
        "MACHINE_TYPE:3D Printer KINEMATICS:Cartesian "
        f"EXTRUDER_COUNT:{printer.head_count} UUID:{UUID}",
        *(
            f"Cap:{word}"
            for word in _CAPABILITIES.format(emergency=int(printer.emergency_parser)).split()
        ),
        f"area:{{full:{box},work:{box}}}",
    ]


BANNER: Final = (
    "start",
    "Marlin bugfix-2.1.x",
    "echo: Last Updated: 2024-10-11 | Author: (none, default config)",
    "echo: Compiled: Nov 20 2026",
    "echo: Free Memory: 5322  PlannerBufferBytes: 1264",
    # The real firmware prints the closing bracket as a number, 41.
    f"echo:V90 stored settings retrieved ({SETTINGS}41",
    "//action:notification Stored settings retrieved",
    "//action:prompt_end",
)
"""What a board says after a reset."""
