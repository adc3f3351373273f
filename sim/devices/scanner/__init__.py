"""Simulated OCT and micro-CT scans of an ink deposit, with random pose and planted defects.

Goes in: deposited ink. Comes out: a volume, its units and the truth. Begin with `oct.py`.
"""

from sim.devices.scanner.defects import Defect, with_defects
from sim.devices.scanner.microct import MicroCtOptions, simulate_microct
from sim.devices.scanner.oct import OctOptions, simulate_oct
from sim.devices.scanner.placing import Placing, ScannerOutput

__all__ = [
    "Defect",
    "MicroCtOptions",
    "OctOptions",
    "Placing",
    "ScannerOutput",
    "simulate_microct",
    "simulate_oct",
    "with_defects",
]
