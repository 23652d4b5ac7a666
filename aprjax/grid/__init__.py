"""Occupancy grids: drawn from scans, covered with viewpoints, and seen by a scanner."""
