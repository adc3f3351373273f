"""Simulated OCT and micro-CT scans of an ink deposit, with random pose and planted defects.

Goes in: deposited ink. Comes out: a volume, its units and the truth. Begin with `oct.py`.
"""
