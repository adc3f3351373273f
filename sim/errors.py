"""Exception classes of simulated devices; bases and those of G-code are in `gcode.errors`."""

from __future__ import annotations

from gcode.errors import SimError


class ServeError(SimError):
    """A port, link or record that can't be served."""


class ScannerError(SimError):
    """A scan that can't be simulated with these settings."""


class CameraError(SimError):
    """A picture that can't be simulated with these settings."""
