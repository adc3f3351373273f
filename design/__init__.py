"""The design side: tissue, vasculature, network, hemodynamics, solids, toolpath."""
