"""Printers behind a network host that runs a job's file: Moonraker, OctoPrint, Duet.

Begin with `host.py` (what a host can do and report); `file_print.py` is the one state machine.
"""
