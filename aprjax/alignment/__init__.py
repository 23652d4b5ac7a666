"""Transformations between anchor graphs (paper 2.C): by votes of edges, or the paper's own way."""
