"""Flow in a print as its G-code or its scan has it.

Goes in: G-code or a scan. Comes out: flow in each vessel. Begin with `printed_case.py`.
"""
