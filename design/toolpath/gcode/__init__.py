"""gcode."""
