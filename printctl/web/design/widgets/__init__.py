"""Widgets of the Design page: recipe editor, run control, run views, comparison."""
