"""Check vessels in G-code before printing: open diameter of each lumen, leaks, merging filaments.

Goes in: G-code and a network or a part. Comes out: each lumen's open diameter, leaks. Begin with
`check.py`.
"""

from printctl.checks.lumens.check import LumenCheck, check_model, check_network
from printctl.checks.lumens.filament_check import (
    FilamentCheck,
    Merge,
    check_filaments,
    find_merges,
    measure_filaments,
)
from printctl.checks.lumens.leaks import DesignedLumens, Leak, find_leaks, network_trees
from printctl.checks.lumens.lines import WrittenLines, filaments, read_lines, rounded_to_steps
from printctl.checks.lumens.model import model_lumens
from printctl.checks.lumens.read import (
    Writing,
    find_filament_place,
    find_place,
    read_filaments,
    read_layers,
    writes_at,
)
from printctl.checks.lumens.report import LumenReport, list_names, report_dict, report_lumens
from printctl.checks.lumens.stations import Openings, SectionStations, measure, network_lumens

__all__ = [
    "DesignedLumens",
    "FilamentCheck",
    "Leak",
    "LumenCheck",
    "LumenReport",
    "Merge",
    "Openings",
    "SectionStations",
    "Writing",
    "WrittenLines",
    "check_filaments",
    "check_model",
    "check_network",
    "filaments",
    "find_filament_place",
    "find_leaks",
    "find_merges",
    "find_place",
    "list_names",
    "measure",
    "measure_filaments",
    "model_lumens",
    "network_lumens",
    "network_trees",
    "read_filaments",
    "read_layers",
    "read_lines",
    "report_dict",
    "report_lumens",
    "rounded_to_steps",
    "writes_at",
]
