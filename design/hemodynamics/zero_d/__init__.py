"""Lumped flow: steady, pulsatile (`pulsatile`), and another solver's files (`svzerod`)."""
