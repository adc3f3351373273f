"""Simulated controller board: parts shared by all simulated firmware families."""
