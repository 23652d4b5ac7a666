"""Matching with many configurations at once: grids of thresholds, and what each of them gives."""
