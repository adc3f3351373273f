"""Serial and network ports: list, detect, lock, open, read and write, log the traffic.

Goes in: a port's name. Comes out: bytes. Begin with `transport.py`.
"""
