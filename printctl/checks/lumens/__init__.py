"""Check vessels in G-code before printing: open diameter of each lumen, leaks, merging filaments.

Goes in: G-code and a network or a part. Comes out: each lumen's open diameter, leaks. Begin with
`check.py`.
"""

from printctl.checks.lumens.check import LumenCheck, check_model, check_network
from printctl.checks.lumens.filament_check import FilamentCheck, check_filaments
from printctl.checks.lumens.filament_sections import measure_filaments
from printctl.checks.lumens.filaments import filaments
from printctl.checks.lumens.leaks import DesignedLumens, Leak, find_leaks
from printctl.checks.lumens.lines import WrittenLines, read_lines, rounded_to_steps
from printctl.checks.lumens.measure import Openings, measure
from printctl.checks.lumens.merges import Merge, find_merges
from printctl.checks.lumens.model import model_lumens
from printctl.checks.lumens.network import network_lumens
from printctl.checks.lumens.place import find_filament_place, find_place
from printctl.checks.lumens.read import Writing, read_filaments, read_layers, writes_at
from printctl.checks.lumens.report import LumenReport, report_dict, report_lumens
from printctl.checks.lumens.stations import SectionStations
from printctl.checks.lumens.trees import network_trees
from printctl.checks.lumens.wording import list_names

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
