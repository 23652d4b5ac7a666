"""Simulated office floors, scanners, odometry, cameras and drives; the engine knows none of it."""
