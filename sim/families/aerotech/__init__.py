"""Reading of Aerotech controllers' programs."""
