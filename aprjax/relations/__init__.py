"""Anchor graphs and the relations of their edges over all references (paper 2.B)."""
