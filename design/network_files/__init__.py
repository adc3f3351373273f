"""Networks from and to files: CSV, JSON, NPZ, SWC, VTP, SimVascular paths; X-CAVATE text in."""
