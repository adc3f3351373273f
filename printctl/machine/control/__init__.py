"""Control of one printer: its modes (idle, printing, paused, looking, ending), checks and requests.

Goes in: a job and requests. Comes out: bytes for the printer, records, status. Begin with
`printing.py`. What waits is steps (`steps.py`), without a clock, port or file; `shell.py` drives
them on those.
"""
