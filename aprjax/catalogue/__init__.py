"""References by the million: kept as scans with a signature each, described when they are needed.

A `ReferenceSet` holds the features of all its references, some tens of kilobytes each, and every
query votes among all of them. A `Catalogue` holds their ranges and a signature of half a kilobyte.
One product compares a query's signature with all of them; the few that are most like it are
described anew and matched as a set of their own. q_m could not choose them: among many references
accidental correspondences of edges outnumber right ones (`python -m experiments.million`).
"""
