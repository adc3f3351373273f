"""Lumped flow: steady (`steady`), pulsatile (`pulsatile`), and another solver's files (`svzerod`)."""
