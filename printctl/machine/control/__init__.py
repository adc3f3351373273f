"""Control of one printer: its modes (idle, printing, paused, looking, ending), checks and requests.

Goes in: a job and requests. Comes out: bytes for the printer, records, status. Begin with
`printing/printing.py`. What waits is steps (`board/steps.py`), without a clock, port or file;
`board/shell.py` drives them on those.
"""
