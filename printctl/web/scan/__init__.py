"""The scan's room: a volume, its alignment and deviation."""
