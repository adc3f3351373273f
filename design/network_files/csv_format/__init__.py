"""Read and write `network.csv`: one straight vessel piece per row, full precision.

Goes in: a network. Comes out: `network.csv`, and the same network read back. Begin with `read.py`.
"""

from design.network_files.csv_format.read import read_network_csv
from design.network_files.csv_format.write import write_network_csv

__all__ = ["read_network_csv", "write_network_csv"]
