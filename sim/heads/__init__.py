"""Print heads as a G-code file uses them: selection, tip positions, valves of pneumatic heads."""
