"""`network.csv` format: one straight vessel piece per row, full precision."""

from design.network_csv.read import read_network_csv
from design.network_csv.write import write_network_csv

__all__ = ["read_network_csv", "write_network_csv"]
