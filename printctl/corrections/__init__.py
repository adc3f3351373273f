"""Corrections from measured prints to the next one."""
