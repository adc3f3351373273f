"""Whole registrations that several files assert on, made once a run."""

import numpy as np
import pytest

from design.network import VesselNetwork
from registration import RegistrationOptions, RegistrationReport, Scan, register_scan
from registration.alignment import AlignmentOptions
from sim.devices.scanner.microct import MicroCtOptions, simulate_microct
from sim.devices.scanner.oct import OctOptions, simulate_oct
from sim.devices.scanner.placing import Placing, ScannerOutput
from tests.made_once import made_once
from tests.registration.parts import (
    analytic_deposit,
    as_scan,
    bent_network,
    lumen_distance,
    lumens,
    planar_construct,
    planar_deposit,
    planar_network,
    solid,
)

FAST = RegistrationOptions(
    alignment=AlignmentOptions(coarse_points=700, fine_points=6000, contest_points=20_000)
)
_GEL = [(x, y, 2.6) for x in (2.0, 5.0, 8.0, 11.0, 14.0) for y in (0.8, 4.0, 7.2)]
_LUMENS = [planar_network().polyline(vessel)[0].mean(axis=0) for vessel in range(4)]
PLANAR_PLACES = np.array([*_GEL, *_LUMENS, (8.0, 4.0, 20.0)])
"""In the gel (15), on the axes of four vessels, and far outside (1)."""
COARSE_OCT = OctOptions(voxel_mm=(0.050, 0.050, 0.050))


def planar_part(factory: pytest.TempPathFactory) -> tuple[ScannerOutput, RegistrationReport]:
    """OCT of a shrunken planar print, with the options that users have."""

    def make() -> tuple[ScannerOutput, RegistrationReport]:
        scanned = simulate_oct(planar_deposit(0.05), COARSE_OCT, seed=4)
        options = RegistrationOptions(places_mm=PLANAR_PLACES)
        return scanned, register_scan(
            as_scan(scanned), planar_construct(), planar_network(), options
        )

    return made_once(factory, "planar_part", make)


def bent_lumens(factory: pytest.TempPathFactory) -> tuple[Scan, RegistrationReport]:
    """Micro-CT of lumens alone."""

    def make() -> tuple[Scan, RegistrationReport]:
        network = bent_network()
        scan = as_scan(microct_of(network, network, seed=3))
        return scan, register_scan(scan, solid(lumens(network)), network, FAST)

    return made_once(factory, "bent_lumens", make)


def microct_of(network: VesselNetwork, printed: VesselNetwork, seed: int) -> ScannerOutput:
    """Micro-CT of a network's place, in which another was printed."""
    low, high = network.nodes.min(axis=0) - 0.7, network.nodes.max(axis=0) + 0.7
    deposit = analytic_deposit(lambda p: lumen_distance(printed, p), low, high, 0.08)
    placing = Placing(rotation_deg=180, tilt_deg=8, margin_mm=1.0, shrink=(0.98, 0.99, 1.0))
    return simulate_microct(deposit, MicroCtOptions(placing=placing), seed)
