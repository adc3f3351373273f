"""`network.csv` format: one straight vessel piece per row, full precision."""

from design.network_files.csv_format.read import read_network_csv
from design.network_files.csv_format.write import write_network_csv

__all__ = ["read_network_csv", "write_network_csv"]
