"""Files: logs, bags, occupancy grids, pose graphs, trajectories, tables, reference sets."""
