"""Simulated printers, boards, cameras and scanners."""
