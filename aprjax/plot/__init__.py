"""Pictures with matplotlib, each a function of its own module.

| | |
|---|---|
| a scan | `aprjax.plot.scan.draw_scan` |
| anchors, and their graph | `aprjax.plot.anchors.draw_anchors` |
| two matched scans, with the synthetic scan | `aprjax.plot.match.draw_match` |
| the hypotheses of a match among the references | `aprjax.plot.answer.draw_answer` |
| matching angles, correspondence matrix | `aprjax.plot.alignment` |
| a run's answers over the floor | `aprjax.plot.map.draw_map` |
| probability against what is right | `aprjax.plot.reliability.draw_reliability` |
| an occupancy grid | `aprjax.plot.grid.draw_grid` |
| a map from a drive | `aprjax.plot.world.draw_world` |
| a tracker's hypotheses in it | `aprjax.plot.hypotheses.draw_hypotheses` |
| volumes of hypotheses in a node's frame, on 3D axes | `aprjax.plot.volume.draw_volumes` |

Each takes what it shows and `ax`, the axes to draw on, and returns the artists it added:

```python
>>> import numpy as np
>>> from matplotlib.figure import Figure
>>> from aprjax.plot.reliability import draw_reliability
>>> from aprjax.plot.style import figure_of
>>> left, right = Figure(figsize=(8, 4)).subplots(1, 2)
>>> drawn = draw_reliability(np.array([0.2, 0.9]), np.array([False, True]), "one", ax=left)
>>> all(artist.axes is left for artist in drawn)
True

```

Without `ax` it draws on those of a new figure of a fitting size, `figure_of(drawn)`. No figure
belongs to a window, and pyplot is not used.
"""
