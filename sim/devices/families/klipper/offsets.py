"""Klipper's coordinate offsets: head position, and shifts applied to a job's coordinates.

What a job calls a place is the head's own place less all shifts. ``shift`` of the modal state leads
from the planner's count to the job's, and `Offsets` keeps what leads from that count to the head's.
"""

from __future__ import annotations

import numpy as np

from sim.devices.board.motion import Motion


class Offsets:
    """Coordinate offsets by SET_KINEMATIC_POSITION and SET_GCODE_OFFSET.

    Parameters
    ----------
    motion : Motion
    """

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        self._own = motion.modal["shift"][0].copy()
        self._offset = np.zeros(3)

    def stand_at(self, values: dict[str, float]) -> None:
        """Say where the head is; what G92 and offsets shift stays shifted."""
        modal = self._motion.modal[0]
        for axis, name in enumerate("XYZ"):
            if name in values:
                own = values[name] - modal["position"][axis]
                modal["shift"][axis] += own - self._own[axis]
                self._own[axis] = own

    def set(self, values: dict[str, float]) -> None:
        """Set an offset without MOVE: what is named later lies so much farther."""
        for axis, name in enumerate("XYZ"):
            now = self._offset[axis]
            value = values.get(name, now + values.get(f"{name}_ADJUST", 0.0))
            self._motion.modal["shift"][0][axis] -= value - now
            self._offset[axis] = value

    def position_report(self) -> str:
        """Say where the head is, and what a job's places are shifted by (GET_POSITION)."""
        modal = self._motion.modal[0]
        head = modal["position"][:3] + self._own
        e, pushed = float(modal["position"][3]), 0.01 * float(modal["flow_percent"])
        plunger = e + float(modal["plunger_shift"])
        named = {
            "toolhead": (head, plunger),
            "gcode": (head, plunger),
            "gcode base": (self._own - modal["shift"], plunger - pushed * e),
        }
        per_mm = self._motion.state["steps_per_mm"][:3]
        motors = zip("xyz", modal["position"][:3], head, per_mm, strict=True)
        steps, places = "", ""
        for axis, mm, at_mm, per_mm in motors:
            steps += f" stepper_{axis}:{round(mm * per_mm)}"
            places += f" stepper_{axis}:{at_mm:.6f}"
        return f"// mcu:{steps}\n// stepper:{places}\n" + "\n".join(
            f"// {name}: X:{x:.6f} Y:{y:.6f} Z:{z:.6f} E:{at:.6f}"
            for name, (x, y, z), at in ((name, mm.tolist(), at) for name, (mm, at) in named.items())
        )
