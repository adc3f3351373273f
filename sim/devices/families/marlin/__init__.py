"""Simulated Marlin firmware: command handlers, line numbers, halts, settings, fast path.

Goes in: bytes of a host. Comes out: Marlin's replies. Begin with `printer.py`.
"""
