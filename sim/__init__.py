"""Simulated printer, scanner, camera; dry run, deposit, needle check, G-code reader.

Import from the modules: `sim.gcode.program.gcode.read_gcode`, `sim.gcode.dry_run.run.dry_run`,
`sim.devices.families.registry.simulated_printer`, `sim.gcode.motion.executed.ExecutedMotion`;
``python -m sim`` is the printer as a process of its own, ``python -m sim camera`` a camera over
its dish. Nothing is imported here, so that what needs one of them doesn't wait for the compiled
kernels of all.

Goes in: G-code. Comes out: executed motion, replies, deposited ink, simulated scans and pictures.
Begin
with `gcode/dry_run/run.py`.
"""
