"""Reader of Aerotech controllers' program files."""
