"""Anchor points of a scan (paper 2.A), and what APR cannot do.

# What APR cannot do

*Where there are no anchors.* An alignment takes at least two anchors that reappear: corners, ends
of surfaces, and where large parts would meet. Empty halls, bare corridors and open ground have
none. The status is then `too_few_anchors` or `no_candidate`, not a guess. Elongated hallways show
one wall like the next: the tracker (`aprjax.tracking`) bridges them by odometry.

*Where places look the same.* Mirror-symmetrical or repeating rooms are told apart only as far as a
scan shows a difference. Two references whose scans look the same everywhere cannot be told from two
scans of one place while nothing says where they are: the answer names both with the same quality
and may still be called confident. With `T_world_ref` in `aprjax.ReferenceSet.build` geometry tells
them apart, and the answer is `ambiguous`.

*Where nothing was seen before.* A query is compared with references; a place that none of them
shows is answered by no hypothesis or a poor one, never by a new place. A reference helps as far as
the two scans see the same: with a half turn's field of view, a place seen from behind is another.

*Where the plane does not hold.* Scans are taken to lie in one plane. A scanner that tilts on a ramp
sees the floor as a wall; a change of its height shows other furniture. Glass and mirrors show free
space or another room.

*Where the scan is distorted.* A scan is one instant. Ranges of a slow scanner on a quickly turning
robot must be corrected for its motion before.

*Where most of it has changed.* People and moved furniture cost agreement; what they hide says
nothing. A hall whose goods are all elsewhere is another hall.

*What was not asked.* Near a known pose, aligning with the last scan is cheaper and no less exact:
`aprjax.tracking.idc`. Nothing here avoids obstacles or makes a grid map while driving; a grid can
be drawn from scans whose poses are known (`aprjax.grid_from_scans`).

`experiments/robustness.py` shows what wears an answer down, and by how much.
"""
