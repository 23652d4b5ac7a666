"""Global self-localization with a 2D laser scanner: APR scan matching in JAX.

One scan goes in, out come its weighted alignments with every stored reference scan, with no prior.
The README says what that is good for, how well it does and how it works. Further pages:

- `aprjax.evaluation`: choosing thresholds, and what to do with an answer
- `aprjax.compilation`: performance, shapes and compilation
- `aprjax.anchors`: what APR cannot do
- `aprjax.plot`: pictures; `aprjax.explanation`: why a query was answered as it was
- `aprjax.world`: maps from a drive; `aprjax.tracking`: where the robot is in one
- `aprjax.io`: logs, bags, grids, pose graphs, trajectories; `aprjax.sim`: simulated floors

# Tutorial

A robot stands somewhere in a flat of three rooms, and has been there before. The flat is simulated
here; scans may as well come from a log (`aprjax.read_log`) or a driver (`aprjax.Scan.make`).

```python
>>> import jax
>>> import numpy as np
>>> import aprjax
>>> from aprjax.sim.laser import Laser, take_scans
>>> from aprjax.sim.world import World
>>> def outline(*corners):
...     return [[a, b] for a, b in zip(corners, corners[1:])]
>>> flat = World.make(
...     outline((0, 0), (11, 0), (11, 7), (0, 7), (0, 0))
...     + outline((4, 0), (4, 1.2), (4.3, 1.2), (4.3, 0))  # a chimney
...     + outline((5, 7), (5, 4.2), (6.1, 4.2)) + outline((7, 4.2), (11, 4.2))
...     + outline((0, 3.1), (1.5, 3.1)) + outline((2.4, 3.1), (3.4, 3.1), (3.4, 7))
...     + outline((8, 0), (8, 0.6), (10.1, 0.6), (10.1, 0))  # a sideboard
... )
>>> def scans_at(poses, seed):
...     stacked = take_scans(jax.random.key(seed), Laser.sick(), flat, None, np.array(poses))
...     return [jax.tree.map(lambda leaf: leaf[i], stacked) for i in range(len(poses))]

```

Poses are x and y in metres and theta in radians, counter-clockwise. Six scans, taken at known
places, become the references. Their places are optional: without them answers are relative to the
references all the same.

```python
>>> places = [[2, 1.5, 0.2], [6, 2, 0], [9, 2.2, 3.0], [8, 5.6, 0.5], [1.6, 5, -1.2], [4.2, 5, 1.5]]
>>> known = aprjax.ReferenceSet.build(scans_at(places, seed=0), T_world_ref=np.array(places))
>>> len(known)
6

```

The robot is switched on, 0.4 m and 20° from where the second one was taken. The first call
compiles (`aprjax.compilation`).

```python
>>> here = np.array([6.3, 2.3, 0.35])
>>> (scan,) = scans_at([here], seed=1)
>>> result = aprjax.match(scan, known)
>>> print(aprjax.Status(int(result.status)).text, bool(result.confident))
ok True
>>> print(result.reference[0])
1

```

`T_ref_query` is the laser's pose in that reference's frame. In the frame that the places were given
in:

```python
>>> from aprjax.metrics import world_poses
>>> T_world_query = world_poses(result, known.ids, known.T_world_ref)[0]
>>> bool(np.hypot(*(T_world_query - here)[:2]) < 0.05)
True

```

It is the first of several hypotheses, best first, each with a quality e_m, the probability of being
right, and a covariance. What is not `valid` is padding.

```python
>>> result.T_ref_query.shape, result.covariance.shape
((5, 3), (5, 3, 3))
>>> quality = result.quality[result.valid]
>>> bool(np.all(np.diff(quality) <= 0)), bool(result.probability[0] > 0.9)
(True, True)

```

A scan in which there is nothing, or that fits nowhere, is no error: its status says what was
missing. No answer is acted on unless it is `confident`.

```python
>>> nothing = aprjax.Scan.make(
...     np.full(181, np.nan), angle_min=-1.57, angle_increment=0.0175, range_max=30.0
... )
>>> lost = aprjax.match(nothing, known)
>>> print(aprjax.Status(int(lost.status)).text, bool(lost.confident))
too_few_anchors False

```

References can be added and removed; ids stay for good. A set is kept in a file.

```python
>>> more = known.add([scan], T_world_ref=here[None])
>>> print(more.ids, more.remove([0]).ids)
[0 1 2 3 4 5 6] [1 2 3 4 5 6]
>>> aprjax.save_references(more, "flat.npz")
>>> len(aprjax.load_references("flat.npz"))
7

```

Why one reference answered, and not another, is a page for a browser: `aprjax.explain(scan, known)`.
"""

from aprjax.batch import match as match
from aprjax.batch import match_batch as match_batch
from aprjax.catalogue.catalogue import Catalogue as Catalogue
from aprjax.catalogue.match import match_catalogue as match_catalogue
from aprjax.compilation import cache_compilations as cache_compilations
from aprjax.compilation import warm_up as warm_up
from aprjax.explanation.report import explain as explain
from aprjax.features import FeatureConfig as FeatureConfig
from aprjax.grid.drawing import grid_from_scans as grid_from_scans
from aprjax.grid.occupancy_grid import OccupancyGrid as OccupancyGrid
from aprjax.io.log import LogEntry as LogEntry
from aprjax.io.log import LogError as LogError
from aprjax.io.logs import read_log as read_log
from aprjax.io.occupancy_grid import OccupancyGridError as OccupancyGridError
from aprjax.io.occupancy_grid import read_occupancy_grid as read_occupancy_grid
from aprjax.io.occupancy_grid import write_occupancy_grid as write_occupancy_grid
from aprjax.io.pose_graph import PoseGraph as PoseGraph
from aprjax.io.pose_graph import PoseGraphEdge as PoseGraphEdge
from aprjax.io.pose_graph import PoseGraphError as PoseGraphError
from aprjax.io.pose_graph import read_pose_graph as read_pose_graph
from aprjax.io.pose_graph import write_pose_graph as write_pose_graph
from aprjax.io.reference_file import ReferenceFileError as ReferenceFileError
from aprjax.io.reference_file import load_references as load_references
from aprjax.io.reference_file import save_references as save_references
from aprjax.io.trajectory import TrajectoryError as TrajectoryError
from aprjax.io.trajectory import read_tum as read_tum
from aprjax.io.trajectory import write_tum as write_tum
from aprjax.matcher import MatchConfig as MatchConfig
from aprjax.references import ReferenceSet as ReferenceSet
from aprjax.result import MatchResult as MatchResult
from aprjax.scan import Scan as Scan
from aprjax.sharding.match import match_sharded as match_sharded
from aprjax.sharding.references import ShardedReferences as ShardedReferences
from aprjax.status import Status as Status
from aprjax.sweeping.axes import configured as configured
from aprjax.sweeping.run import sweep as sweep
from aprjax.sweeping.run import sweep_grid as sweep_grid
from aprjax.tracking.tracker import HypothesisTracker as HypothesisTracker
from aprjax.tracking.tracker import TrackerConfig as TrackerConfig
from aprjax.world.build import MapConfig as MapConfig
from aprjax.world.build import build_map as build_map
from aprjax.world.model import WorldModel as WorldModel
from aprjax.world.parts import WorldModelError as WorldModelError
from aprjax.world.store import MapFileError as MapFileError
from aprjax.world.store import load_map as load_map
from aprjax.world.store import save_map as save_map

# In the order of use, and with the modules: the API reference shows what is named here.
__all__ = [  # noqa: RUF022
    "Scan",
    "read_log",
    "LogEntry",
    "LogError",
    "ReferenceSet",
    "save_references",
    "load_references",
    "ReferenceFileError",
    "FeatureConfig",
    "match",
    "match_batch",
    "MatchConfig",
    "MatchResult",
    "Status",
    "explain",
    "sweep",
    "sweep_grid",
    "configured",
    "warm_up",
    "cache_compilations",
    "ShardedReferences",
    "match_sharded",
    "Catalogue",
    "match_catalogue",
    "OccupancyGrid",
    "read_occupancy_grid",
    "write_occupancy_grid",
    "OccupancyGridError",
    "grid_from_scans",
    "build_map",
    "MapConfig",
    "WorldModel",
    "WorldModelError",
    "save_map",
    "load_map",
    "MapFileError",
    "HypothesisTracker",
    "TrackerConfig",
    "PoseGraph",
    "PoseGraphEdge",
    "read_pose_graph",
    "write_pose_graph",
    "PoseGraphError",
    "read_tum",
    "write_tum",
    "TrajectoryError",
    "alignment",
    "anchors",
    "atomic",
    "batch",
    "calls",
    "catalogue",
    "compilation",
    "configuration",
    "contract",
    "describing",
    "evaluation",
    "explanation",
    "features",
    "grid",
    "io",
    "matcher",
    "metrics",
    "numerics",
    "packing",
    "places",
    "plane",
    "plot",
    "programs",
    "references",
    "refine",
    "relations",
    "result",
    "scan",
    "se2",
    "sharding",
    "shortlist",
    "sim",
    "status",
    "sweeping",
    "tracking",
    "world",
]
