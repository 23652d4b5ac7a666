import numpy as np

from aprjax.plot.hypotheses import draw_hypotheses, picture_of
from aprjax.plot.style import figure_of
from aprjax.world.super_space import assemble
from tests.tracking.worlds import at, corridor, sure, tracker


def triangles_of(figure):
    return next(
        c.get_paths() for c in figure.axes[0].collections if type(c).__name__ == "PolyCollection"
    )


def test_hypotheses_are_triangles_with_a_circle_round_the_strongest_and_their_probabilities():
    world = corridor()
    made = tracker(world)
    made.observe(estimates=[at(0, 1.0, probability=0.9), at(2, 0.5, probability=0.3)])
    figure = figure_of(draw_hypotheses(world, assemble(world), made.belief, "after cycle 1"))
    assert len(triangles_of(figure)) == 2
    circle = figure.axes[0].collections[-1]
    np.testing.assert_allclose(circle.get_offsets(), [[1.0, 0.0]])
    text = figure.axes[0].texts[-1].get_text()
    assert "after cycle 1" in text
    assert f"{made.belief.best.probability:.2f}" in text
    assert f"{made.rest:.2f}" in text


def test_a_belief_without_hypotheses_is_drawn_as_the_map():
    world = corridor()
    figure = figure_of(draw_hypotheses(world, assemble(world), tracker(world).belief))
    assert len(triangles_of(figure)) == 0
    assert "1.00" in figure.axes[0].texts[-1].get_text()


def test_hypotheses_in_a_part_that_the_frame_does_not_hold_are_left_out():
    world = corridor()
    apart = world.add_node()
    made = sure(world=world, node=apart)
    assert made.belief.best.place.node == apart
    figure = figure_of(draw_hypotheses(world, assemble(world), made.belief))
    assert len(triangles_of(figure)) == 0


def test_a_figure_becomes_a_picture_of_a_film():
    world = corridor()
    drawn = draw_hypotheses(world, assemble(world), sure(world=world).belief)
    picture = picture_of(figure_of(drawn), 40)
    assert picture.mode == "P"
    assert min(picture.size) > 50


def test_the_legend_names_the_triangles_and_the_circle_once():
    world = corridor()
    made = tracker(world)
    made.observe(estimates=[at(0, 1.0, probability=0.9), at(2, 0.5, probability=0.3)])
    axes = figure_of(draw_hypotheses(world, assemble(world), made.belief)).axes[0]
    named = [text.get_text() for text in axes.get_legend().get_texts()]
    assert named.count("hypotheses (2), pointing ahead") == 1
    assert named.count("the strongest") == 1
