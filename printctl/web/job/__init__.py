"""The job's room: preflight, start, pause, progress, what is done after a print."""
