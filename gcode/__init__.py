"""Read, time and dry-run G-code, and predict what it deposits; shares no code with its writer.

Import from the modules: `gcode.program.gcode.read_gcode`, `gcode.dry_run.run.dry_run`,
`gcode.motion.executed.ExecutedMotion`.

Goes in: G-code. Comes out: executed motion, time, findings, deposited ink. Begin with
`dry_run/run.py`.
"""
