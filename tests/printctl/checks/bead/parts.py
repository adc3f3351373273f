"""Test job: a tapered vessel, 1.0 to 0.3 mm over 20 mm, as G-code with its map."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from design.toolpath.embedded import EmbeddedOptions, plan_embedded
from design.toolpath.gcode import GcodeOptions, save_gcode, stream_gcode
from design.toolpath.lag import compensate_lag
from firmware_profiles import Printer, Syringe, load
from printctl.checks.preflight import written_arrays

LAG_S = 0.3
PLACE = (50.0, 50.0, 50.0)
START = (50.0, 50.0, 80.0)


def tapered() -> VesselNetwork:
    x = np.linspace(0, 20, 41)
    points = np.column_stack([x, np.zeros((len(x), 2))])
    return VesselNetwork(
        points[[0, -1]], np.array([[0, 1]]), np.array([0]), np.array([0]),
        np.array([0, len(x)]), points, np.linspace(0.5, 0.15, len(x)),
    )  # fmt: skip


def write_job(folder: Path, lag_s: float = 0.0, printer: str = "generic_marlin") -> Path:
    """Network, G-code and map in a folder; ahead of a lag where it is above 0."""
    network, profile, syringe = tapered(), load(Printer, printer), load(Syringe, "hamilton_1ml")
    write_network_csv(folder / "network.csv", network)
    path = plan_embedded(network, EmbeddedOptions(retract_ul=0.0)).toolpath
    if lag_s > 0:
        rate = 0.5 * profile.max_speed_mm_s.e * math.pi / 4 * syringe.inner_mm**2
        path = compensate_lag(path, lag_s, rate).toolpath
    options = GcodeOptions(start_mm=START, relieve_ul=0.0)
    job = stream_gcode([path], profile, syringe, PLACE, options, 1.0)
    beside = written_arrays(network, np.array(PLACE), 0.5, 0.05, [(0.31, 0.31, 0.0)])
    if lag_s > 0:
        beside["lag_s"] = np.array(lag_s)
    save_gcode(folder / "job.gcode", folder / "job.map.npz", job, beside)
    return folder / "job.gcode"
