"""Scan page of the web interface: a volume, its alignment and its deviation from the design."""
