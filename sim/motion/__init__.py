"""Marlin's motion: planner, stepper, and the executed motion at the motors."""
