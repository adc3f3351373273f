"""Simulated printers, scanners and cameras, on the same ports and in the same formats as real ones.

Import from the modules: `sim.devices.families.registry.simulated_printer`; ``python -m sim`` is the
printer as a process of its own, ``python -m sim camera`` a camera over its dish. Nothing is
imported here, so that what needs one of them doesn't wait for the compiled kernels of all.

Goes in: G-code, or what was printed. Comes out: replies, simulated scans and pictures. Begin with
`devices/serving/serve.py`.
"""
