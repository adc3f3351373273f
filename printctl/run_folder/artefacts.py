"""File names of a run folder, shared by stages and commands.

Nothing is imported here, so that a command can name them before anything heavy is loaded.
"""

NETWORK = "network.csv"
NETWORK_ARRAYS = "network.npz"
LUMEN = "lumen.stl"
SOLID = "solid.stl"
SURFACE = "tissue.stl"
JOURNAL_FOLDER = "print"
GCODE, LINE_MAP = "part.gcode", "part.map.npz"
PRINTED_WITH = "compensation.json"
OXYGEN = "oxygen.csv"
NUMBERS = "registration.json"
PLATE_TABLE, PLATE_PICTURE = "wells.csv", "plate.svg"
HTML, JSON, PDF = "report.html", "report.json", "report.pdf"
