"""The search for short expressions: random monotone functions, whose terms are found by brute force."""

import itertools

import numpy as np
import pytest

from inc_casadi.affine_pieces import search as module
from inc_casadi.affine_pieces.expression import Gate, flat, fulfils, leaves, truth, units
from inc_casadi.affine_pieces.order import Order
from inc_casadi.affine_pieces.search import shortest_expression
from inc_casadi.errors import InvalidInputError


def table(above, below):
    above, below = np.array(above, bool), np.array(below, bool)
    L = above.shape[1]
    return Order(np.zeros((L, 1)), np.zeros(L), above, below, 0.0)


def random_expression(rng, laws):
    """An expression in which each law stands once."""
    if len(laws) == 1:
        return int(laws[0])
    cut = rng.integers(1, len(laws))
    return Gate(str(rng.choice(["max", "min"])), (random_expression(rng, laws[:cut]), random_expression(rng, laws[cut:])))


def order_of(expression, L, pairs=()):
    """The pairs (set that makes it true, complement of a set that leaves it false) of a monotone function, all of them.

    pairs (a, b): only sets that hold b if they hold a.
    """
    points = np.array(list(itertools.product([False, True], repeat=L)))
    for a, b in pairs:
        points = points[~points[:, a] | points[:, b]]
    value = truth(expression, points)
    true, false = points[value], ~points[~value]
    size = max(len(true), len(false))
    return table(np.resize(true, (size, L)), np.resize(false, (size, L)))


@pytest.mark.parametrize("seed", range(12))
def test_an_expression_with_each_law_once_is_found_again(seed):
    rng = np.random.default_rng(seed)
    hidden = random_expression(rng, rng.permutation(8))
    order = order_of(hidden, 8)
    found = shortest_expression(order)
    assert leaves(found) == 8 and units(found) == 7 and fulfils(found, order)


@pytest.mark.parametrize("seed, most", [(0, 12), (3, 7), (6, 8), (21, 14)])
def test_whatever_is_found_is_right_and_ways_compared_make_it_short(seed, most):
    # Sets that meet pairwise, with no expression behind them. Without a second search: 14, 7, 15 and 24 leaves.
    rng = np.random.default_rng(seed)
    above, below = rng.random((14, 9)) < 0.5, rng.random((14, 9)) < 0.5
    meet = (above[:, None] & below[None]).any(axis=2)
    above[:, 0] |= ~meet.all(axis=1)
    below[:, 0] |= ~meet.all(axis=0)
    order = table(above, below)
    found = shortest_expression(order)
    assert fulfils(found, order) and leaves(found) <= most


def test_majority_needs_more_leaves_than_laws():
    # Two of three is no expression with each law once; five leaves are the least.
    two = [[1, 1, 0], [1, 0, 1], [0, 1, 1]]
    found = shortest_expression(table(two, two))
    assert leaves(found) == 5 and fulfils(found, table(two, two))


def test_a_wrong_expression_is_told():
    two = table([[1, 1, 0], [1, 0, 1], [0, 1, 1]], [[1, 1, 0], [1, 0, 1], [0, 1, 1]])
    assert not fulfils(Gate("max", (0, 1, 2)), two) and not fulfils(Gate("min", (0, 1, 2)), two)
    assert not fulfils(Gate("max", (0, Gate("min", (1, 2)))), two)


def test_clips_are_taken_where_laws_lie_a_constant_apart():
    inner = Gate("max", (2, Gate("min", (3, 4))))
    clipped = flat(Gate("max", (0, Gate("min", (1, inner)))))
    order = order_of(clipped, 5, [(0, 1), (2, 3)])
    found = shortest_expression(order, frozenset({(0, 1), (2, 3)}))
    assert found == Gate("clip", (0, 1, Gate("clip", (2, 3, 4)))) and fulfils(found, order)
    assert units(found) == 2 and leaves(found) == 5
    assert shortest_expression(order, frozenset({(1, 0)})) == shortest_expression(order)


def test_a_clip_is_not_taken_where_a_law_must_pass_it():
    # Law 0 is below everywhere, but law 3 passes law 1.
    hidden = Gate("max", (0, 3, Gate("min", (1, 2))))
    order = order_of(hidden, 4, [(0, 1)])
    assert fulfils(shortest_expression(order, frozenset({(0, 1)})), order)


def test_parts_that_return_count_once():
    part = Gate("min", (0, 1))
    assert units(Gate("max", (part, Gate("min", (2, Gate("max", (part, 3))))))) == 4


def test_too_many_laws_are_refused(monkeypatch):
    monkeypatch.setattr(module, "LAWS", 2)
    with pytest.raises(InvalidInputError, match="3 distinct affine laws in one output, more than 2"):
        shortest_expression(table([[1, 1, 0]], [[1, 0, 1]]))
