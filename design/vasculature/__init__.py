"""vasculature."""
