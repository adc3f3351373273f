"""Printer page of the web interface: connection, manual control, console, calibration.

Goes in: requests of a browser. Comes out: commands to the station, and its status. Begin with
`service.py`.
"""
