"""Simulated printer, scanner and dye video; dry run, ink deposit, needle check, G-code reader.

Import from the modules: `sim.program.gcode.read_gcode`, `sim.dry_run.run.dry_run`,
`sim.families.registry.simulated_printer`, `sim.motion.executed.ExecutedMotion`;
``python -m sim`` is the printer as a process of its own. Nothing is imported here, so that what
needs one of them doesn't wait for the compiled kernels of all.

Goes in: G-code. Comes out: executed motion, replies, deposited ink, simulated scans. Begin with
`dry_run/run.py`.
"""
