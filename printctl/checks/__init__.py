"""Checks of a job before it may reach a printer."""
