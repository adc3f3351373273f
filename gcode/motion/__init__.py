"""Marlin's motion: planner, stepper, and the executed motion at the motors.

Goes in: target positions and feeds. Comes out: executed motion. Begin with `planner.py`.
"""
