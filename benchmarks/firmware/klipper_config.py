"""Write the printer.cfg of a Klipper bioprinter whose pins are stubs (``board/gpio_stub.c``)."""

from __future__ import annotations

from pathlib import Path

STEPS_PER_MM = {"X": 80, "Y": 80, "Z": 400, "E": 6400}
START_MM = {"X": 100.0, "Y": 100.0, "Z": 50.0}
MICROSTEPS = 3200
AXIS = """
[stepper_{name}]
step_pin: gpio{step}
dir_pin: gpio{direction}
enable_pin: !gpio{enable}
microsteps: 16
rotation_distance: {rotation}
endstop_pin: gpio{endstop}
position_endstop: 0
position_min: -1
position_max: 250
"""
REST = """
[extruder]
step_pin: gpio9
dir_pin: gpio10
enable_pin: !gpio11
microsteps: 16
rotation_distance: {rotation}
nozzle_diameter: 0.15
filament_diameter: 4.61
max_extrude_cross_section: 100
max_extrude_only_distance: 200
max_extrude_only_velocity: 5
max_extrude_only_accel: 500
heater_pin: gpio12
sensor_type: temperature_host
sensor_path: {temperature}
control: watermark
min_temp: 0
max_temp: 100
min_extrude_temp: 0

[printer]
kinematics: cartesian
max_velocity: 100
max_accel: 500
max_z_velocity: 5
max_z_accel: 100

[force_move]
enable_force_move: True

[mcu]
serial: {mcu}
"""


def write_config(path: Path, mcu: Path, temperature: Path) -> None:
    """Write the configuration; ``mcu`` is the process's port, ``temperature`` a file in m°C."""
    text = ""
    for i, name in enumerate("xyz"):
        rotation = MICROSTEPS / STEPS_PER_MM[name.upper()]
        pins = {"step": 3 * i, "direction": 3 * i + 1, "enable": 3 * i + 2, "endstop": 13 + i}
        text += AXIS.format(name=name, rotation=rotation, **pins)
    rotation = MICROSTEPS / STEPS_PER_MM["E"]
    path.write_text(text + REST.format(rotation=rotation, mcu=mcu, temperature=temperature))


def start_steps() -> str:
    """Return where the carriage stands at the start, steps, as the stub reads it."""
    return ",".join(str(round(START_MM[axis] * STEPS_PER_MM[axis])) for axis in "XYZ")
