"""The history's room: past prints, their records, and a print again."""
