"""Lumens of emitted G-code: how open each vessel will be, before anything is printed."""

from printctl.lumens.check import LumenCheck, check_model, check_network
from printctl.lumens.leaks import Leak, Lumens, find_leaks
from printctl.lumens.lines import WrittenLines, read_lines, rounded_to_steps
from printctl.lumens.measure import Openings, measure
from printctl.lumens.model import model_lumens
from printctl.lumens.network import network_lumens
from printctl.lumens.place import find_place
from printctl.lumens.report import LumenReport, report_dict, report_lumens
from printctl.lumens.stations import Stations
from printctl.lumens.trees import network_trees

__all__ = [
    "Leak",
    "LumenCheck",
    "LumenReport",
    "Lumens",
    "Openings",
    "Stations",
    "WrittenLines",
    "check_model",
    "check_network",
    "find_leaks",
    "find_place",
    "measure",
    "model_lumens",
    "network_lumens",
    "network_trees",
    "read_lines",
    "report_dict",
    "report_lumens",
    "rounded_to_steps",
]
