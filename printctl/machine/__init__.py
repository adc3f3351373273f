"""The printer: link process, manual commands, prints and their state.

Goes in: a checked job. Comes out: a print, its journal and state. Begin with `process/machine.py`.
"""
