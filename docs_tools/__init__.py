"""What makes pages of the user guide: not part of the product."""
