"""Linear waves in uniform tubes, one frequency at a time: the oracle for small pulses.

With pressure and flow as Re(x e^{iωt}): -p' = (ϱ iω + ϱ f/A)/A q and -q' = iω 2A/(K (1 + iωτ)) p.
"""

from dataclasses import dataclass

import numpy as np

from design.network import VesselNetwork


@dataclass(frozen=True)
class Tube:
    """A vessel: length mm, area mm², stiffness Pa, friction f mm²/s, density, relaxation s."""

    length: float
    area: float
    stiffness: float
    friction: float
    density: float
    relaxation: float = 0.0

    def propagation(self, omega: float) -> complex:
        """Decay and turn of phase per mm."""
        return complex(np.sqrt(self._series(omega) * self._shunt(omega)))

    def impedance(self, omega: float) -> complex:
        """Pressure over flow of a wave by itself."""
        return complex(np.sqrt(self._series(omega) / self._shunt(omega)))

    def _series(self, omega: float) -> complex:
        return self.density / self.area * (1j * omega + self.friction / self.area)

    def _shunt(self, omega: float) -> complex:
        return 2j * omega * self.area / (self.stiffness * (1.0 + 1j * omega * self.relaxation))


def node_pressures(
    network: VesselNetwork,
    tubes: list[Tube],
    omega: float,
    source: dict[int, complex],
    load: dict[int, complex],
) -> np.ndarray:
    """Pressure at each node for flows into some, and admittances to ground at some; dense."""
    count = len(network.nodes)
    matrix = np.zeros((count, count), dtype=complex)
    for (a, b), tube in zip(network.vessel_nodes, tubes, strict=True):
        turn = tube.propagation(omega) * tube.length
        z = tube.impedance(omega)
        own, other = 1.0 / (z * np.tanh(turn)), -1.0 / (z * np.sinh(turn))
        matrix[a, a] += own
        matrix[b, b] += own
        matrix[a, b] += other
        matrix[b, a] += other
    for node, admittance in load.items():
        matrix[node, node] += admittance
    right = np.zeros(count, dtype=complex)
    for node, flow in source.items():
        right[node] += flow
    return np.linalg.solve(matrix, right)
