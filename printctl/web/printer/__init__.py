"""Printer page of the web interface: connection, manual control, console, calibration."""
