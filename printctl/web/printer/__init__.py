"""The printer's room: connection, manual control, console, calibration."""
