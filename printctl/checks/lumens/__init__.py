"""Check vessels in G-code before printing: open diameter of each lumen, leaks, merging filaments.

Goes in: G-code and a network or a part. Comes out: each lumen's open diameter, leaks. Begin with
`check.py`.
"""

from printctl.checks.lumens.check import LumenCheck, check_model, check_network
from printctl.checks.lumens.filament_check import (
    FilamentCheck,
    check_filaments,
)
from printctl.checks.lumens.leaks import Leak, find_leaks, network_trees
from printctl.checks.lumens.lines import WrittenLines, read_lines, rounded_to_steps
from printctl.checks.lumens.model import model_lumens
from printctl.checks.lumens.read import (
    Writing,
    find_filament_place,
    find_place,
    read_filaments,
    read_layers,
    writes_at,
)
from printctl.checks.lumens.report import list_names, report_lumens
from printctl.checks.lumens.stations import Openings, SectionStations, measure, network_lumens

__all__ = [
    "FilamentCheck",
    "Leak",
    "LumenCheck",
    "Openings",
    "SectionStations",
    "Writing",
    "WrittenLines",
    "check_filaments",
    "check_model",
    "check_network",
    "find_filament_place",
    "find_leaks",
    "find_place",
    "list_names",
    "measure",
    "model_lumens",
    "network_lumens",
    "network_trees",
    "read_filaments",
    "read_layers",
    "read_lines",
    "report_lumens",
    "rounded_to_steps",
    "writes_at",
]
