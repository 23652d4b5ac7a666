"""The hybrid world model (paper 3): places with frames, arcs between them, built from a drive."""
