"""Simulated printers, boards, cameras and scanners.

Goes in: profiles, faults, deposits. Comes out: a printer on a port, pictures, scans. Begin with
`serving/serve.py`.
"""
