"""Job page of the web interface: preflight, start, pause, progress, steps after the print.

Goes in: G-code files and a set-up. Comes out: checks, a running print, its record. Begin with
`service.py`.
"""
