"""Job page of the web interface: preflight, start, pause, progress, steps after the print."""
