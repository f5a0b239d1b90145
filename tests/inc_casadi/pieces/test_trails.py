"""The tree of laws: where cells were, what they went through, and the numbers that patterns have in its table."""

import numpy as np

from inc_casadi.pieces.cutting import Cuts
from inc_casadi.pieces.trails import Trails


def cuts(parent, patterns, bound, level):
    return Cuts(np.array(parent), np.array(patterns), np.array(bound), np.array(level))


def path(trails, node):
    """The patterns on the way to a node, first step first."""
    out = []
    while trails.parent[node] >= 0:
        out.append(tuple(trails.patterns[trails.pattern[node]].tolist()))
        node = trails.parent[node]
    return out[::-1]


def test_paths_are_the_patterns_that_cells_went_through():
    rng = np.random.default_rng(0)
    trails, node = Trails.begin(3), np.zeros(1, int)
    walked = [[]]
    for step in range(5):
        parent = np.repeat(np.arange(len(node)), 2)  # every cell is cut in two
        patterns = rng.integers(0, 3, (len(parent), 3))
        before = trails
        trails, after = trails.stepped(node[parent], patterns)
        np.testing.assert_array_equal(trails.patterns[:len(before.patterns)], before.patterns)
        walked = [[*walked[i], tuple(pattern.tolist())] for i, pattern in zip(parent, patterns, strict=True)]
        node = after
        assert [path(trails, i) for i in node] == walked
        assert set(trails.depth[node]) == {step + 1} and np.all(trails.parent[1:] < np.arange(1, len(trails.parent)))


def test_cells_that_share_their_steps_share_a_node_and_others_do_not():
    trails, node = Trails.begin(2).stepped(np.zeros(4, int), np.array([[0, 1], [1, 1], [0, 1], [1, 0]]))
    assert node[0] == node[2] and len(set(node)) == 3
    trails, node = trails.stepped(node, np.array([[1, 1]] * 4))
    assert node[0] == node[2] and len(set(node)) == 3 and trails.depth.max() == 2
    assert len(trails.patterns) == 3 and len(trails.parent) == 7


def test_cuts_are_kept_in_order_with_the_node_and_pattern_of_their_cell():
    trails, node = Trails.begin(2).stepped(np.zeros(2, int), np.array([[0, 0], [2, 1]]))
    trails = trails.with_cuts(cuts([1, 0, 1], [[1, 1], [2, 1], [0, 0]], [3, 0, 2], [0.5, 0.0, -0.25]), node)
    assert trails.node.tolist() == [node[1], node[0], node[1]]
    assert trails.patterns[trails.row].tolist() == [[1, 1], [2, 1], [0, 0]]
    assert trails.bound.tolist() == [3, 0, 2] and trails.level.tolist() == [0.5, 0.0, -0.25]
    later = trails.with_cuts(cuts([0], [[1, 1]], [1], [0.0]), node)
    assert later.row.tolist() == [*trails.row, trails.row[0]] and later.node.tolist() == [*trails.node, node[0]]


def test_a_law_without_units_has_one_pattern():
    trails, node = Trails.begin(0).stepped(np.zeros(3, int), np.zeros((3, 0), int))
    trails, node = trails.stepped(node, np.zeros((3, 0), int))
    assert trails.patterns.shape == (1, 0) and trails.depth.tolist() == [0, 1, 2] and node.tolist() == [2, 2, 2]
