import numpy as np

from aprjax.grid.occupancy_grid import OccupancyGrid
from aprjax.plot.grid import draw_grid
from aprjax.plot.style import figure_of


def test_cells_are_drawn_where_they_lie_in_the_world():
    cells = np.zeros((20, 40))
    cells[5, 30] = 100
    grid = OccupancyGrid.make(cells, 0.1, [2.0, -1.0, np.pi / 2])
    drawn = draw_grid(grid, np.array([[1.0, 0.0]]), wrong=np.array([[1.0, 1.0, 0.5]]))
    (ax,) = figure_of(drawn).axes
    (image,) = ax.images
    corner = image.get_transform().transform([[30.5, 5.5]])
    np.testing.assert_allclose(ax.transData.inverted().transform(corner), [[1.45, 2.05]], atol=1e-6)
    # Turned by 90°, the grid's x is the world's y.
    assert ax.get_xlim()[0] < 0.1
    assert ax.get_ylim()[1] > 2.9
    labels = ax.get_legend_handles_labels()[1]
    assert labels == ["viewpoints (1)", "wrong (1)"]


def test_occupied_is_black_free_white_and_unknown_grey():
    grid = OccupancyGrid.make(np.array([[-1, 0, 100]]), 0.1)
    (ax,) = figure_of(draw_grid(grid)).axes
    shown = np.asarray(ax.images[0].get_array())
    np.testing.assert_array_equal(shown, [[0.8, 1.0, 0.0]])
