"""The hybrid world model (paper 3): places with frames, arcs between them, built from a drive.

Nodes are places with a metric frame of their own. Arcs hold the pose of their ends' frames to each
other, with its covariance, and reference scans sit at the arcs' ends. No frame holds everywhere:
`aprjax.world.super_space` composes those of nodes along the arcs, and `aprjax.world.relax` makes
one of all for a drawing.

How a drive becomes a map
-------------------------
`aprjax.build_map` takes scans and raw odometry, and no corrected poses.

1. *Motion* (`aprjax.world.motion`). Each scan is aligned with the one before it and with those 1, 2
   and 3 m before it, from several starts, since odometry may be 36° off in a step. All pairs that
   agree, and odometry, go into one robust sparse least-squares problem.
2. *Recognition* (`aprjax.world.recognition`). Each scan is matched globally with all those over 15
   m of way before it.
3. *Closure* (`aprjax.world.closure`). Answers to at least three scans over 1.5 m, within 6 m of
   way, have to mean one pose; no other place may have half as much for it; and the cycle must miss
   its start by less than two deviations of what the arcs and dead reckoning allow. Whether two
   answers mean one pose is asked along the arcs between the places that they name, not along those
   from the robot, which may lead the one or the other way round a cycle that is torn. The look of a
   corridor is not evidence enough: the way driven decides.
4. *Following* (`aprjax.world.follow`). Once back, a scan is aligned with the references near where
   it is expected, until none agrees: then the place is new. Where much is possible (0.6 m or 6° of
   deviation), it takes firm agreement.
5. *Arcs* (`aprjax.world.arcs`) are estimated anew, each by itself, from all pairs measured around
   its two nodes. Nodes that turn out to be one place are merged, small triangles at crossings and
   arcs that two others make superfluous removed (`aprjax.world.tidy`).

An error in the heading of a node's own scan is one of all its arcs. Each node therefore has the
frame of a scan about its middle whose heading the scans around it hold well, and about which the
robot turned little: a scan that was taken in a turn is skewed.

Where a map says nothing
------------------------
Consecutive scans without anything in common leave odometry alone. A step whose odometry is
uncertain by more than 0.6 m or 6° becomes no arc, and the map falls into parts.
"""
