"""Continuous piecewise-affine laws as INCs: the same function, few units, and refusals that name what is wrong."""

import importlib

import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, Polytope, Regional, Saturation, certify, largest_difference, regions
from inc_casadi.affine_pieces import represent
from inc_casadi.affine_pieces.expression import Gate
from inc_casadi.errors import ConvergenceError, DimensionError, InvalidInputError
from inc_casadi.mpc import MPC
from inc_casadi.pieces.critical_regions import CriticalRegions


def net(seed, *sizes, bias=0.5):
    """A random ReLU network with layers of these sizes, and a box off center."""
    rng = np.random.default_rng(seed)
    layers = [(rng.normal(size=(b, a)), bias * rng.normal(size=b)) for a, b in zip(sizes[:-1], sizes[1:], strict=True)]
    return INC.from_layers(layers), Box(-1.5 * np.ones(sizes[0]), 2.0 + 0.1 * np.arange(sizes[0]))


def pieces_of(law, region):
    return regions(Plant(np.eye(law.p), np.ones((law.p, law.m))), law, region)


def double_integrator(horizon):
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]])
    return plant, MPC(plant, np.eye(2), [[1.0]], horizon, Box([-1.0], [1.0]))


WIDE = Box([-100.0, -30.0], [100.0, 30.0])
LEFT, RIGHT = (Box([-2.0], [0.0]), [[-1.0]], [0.0]), (Box([0.0], [3.0]), [[1.0]], [0.0])


@pytest.mark.parametrize("sizes", [(1, 5, 1), (1, 4, 3, 2), (2, 5, 1), (2, 4, 4, 1), (2, 3, 3, 2), (3, 3, 2, 1),
                                   (3, 2, 2, 2)])
def test_a_network_is_the_same_function_as_its_pieces(sizes):
    law, region = net(sum(sizes), *sizes)
    found = represent(pieces_of(law, region))
    apart = largest_difference(law, found.inc, region)
    assert apart.ended == "" and apart.value <= 1e-13 * (1 + apart.size) and found.error <= 1e-13 * (1 + apart.size)
    np.testing.assert_array_equal(np.triu(found.inc.W), 0.0)
    assert found.inc.contraction.radius == 0.0 and found.inc.well_posedness().holds


@pytest.mark.parametrize("horizon, count", [
    (2, 9), (3, 19), (4, 33), *(pytest.param(*case, marks=pytest.mark.slow) for case in ((5, 51), (6, 73)))])
def test_units_of_explicit_predictive_control(horizon, count):
    plant, mpc = double_integrator(horizon)
    pieces = regions(plant, CriticalRegions(mpc), WIDE)
    found, short = represent(pieces), represent(pieces, saturations=True)
    # Two ReLU for each move of the horizon, one fewer than laws; or one saturation, as the implicit law of from_mpc has.
    assert found.pieces == count and found.laws == (2 * horizon + 1,) and found.inc.q == 2 * horizon
    assert short.inc.q == horizon == mpc.inc().q and short.inc.activations == (Saturation(),) * horizon
    for each in (found, short):
        np.testing.assert_array_equal(np.triu(each.inc.W), 0.0)
        assert largest_difference(CriticalRegions(mpc), each.inc, WIDE).value < 5e-12
        assert each.jump < 1e-12 and each.error < 5e-12


def test_the_plain_max_min_form_takes_many_more():
    # max over regions of the minimum of all laws above: a unit for each pair.
    plant, mpc = double_integrator(4)
    pieces = regions(plant, CriticalRegions(mpc), WIDE)
    G, g, which = pieces.distinct_laws()
    values = np.einsum("lmn,kcn->klcm", G, pieces.simplices)[..., 0] + g[None, :, None, 0]
    own = np.take_along_axis(values, which[pieces.which][:, None, None], axis=1)
    above = np.array([np.all(values >= own - 1e-9, axis=2)[pieces.which == i].all(axis=0) for i in range(len(pieces))])
    assert above.sum() - 1 == 140 and represent(pieces).inc.q == 8


@pytest.mark.parametrize("saturations", [False, True])
def test_certified_cost_of_explicit_and_implicit_law(saturations):
    plant, mpc = double_integrator(3)
    claim = Regional(Box([-6.0, -2.0], [5.0, 3.0]), Box([-1.0], [1.0]), np.eye(2), [[1.0]], 0.98)
    inc = INC.from_affine_pieces(regions(plant, CriticalRegions(mpc), WIDE), saturations=saturations)
    explicit, implicit = certify(plant, inc, claim).require(), certify(plant, INC.from_mpc(
        plant, np.eye(2), [[1.0]], 3, Box([-1.0], [1.0])), claim).require()
    assert explicit.expected == pytest.approx(implicit.expected, rel=1e-12)
    assert explicit.worst[0] == pytest.approx(implicit.worst[0], rel=1e-9)


@pytest.mark.parametrize("saturations", [False, True])
def test_limits_hold_to_the_last_bit(saturations):
    mpc = MPC(Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]]), np.eye(2), [[1.0]], 3, Box([-0.3], [0.3]))
    inc = INC.from_affine_pieces(regions(mpc.plant, mpc.inc(), Box([-30.0, -9.0], [30.0, 10.0])), saturations=saturations)
    u = inc(np.random.default_rng(0).normal(size=(2, 20_000)) * 100)
    assert u.min() == -0.3 and u.max() == 0.3


def test_small_laws_by_hand():
    single = represent([(Box([-1.0, 0.0], [1.0, 3.0]), [[1.0, 2.0], [0.0, -1.0]], [3.0, 0.5])])
    assert single.inc.q == 0 and single.inc([1.0, 1.0]).tolist() == [6.0, -0.5] and single.jump == 0.0
    absolute = represent([LEFT, RIGHT])
    assert absolute.inc.q == 1 and absolute.forms == ("hinges",)
    assert absolute.inc([[-2.0, 0.0, 1.5]]).tolist() == [[2.0, 0.0, 1.5]]
    law, region = INC.saturated([[-0.8]], 1.0), Box([-2.0], [3.0])
    saturated, one = represent(pieces_of(law, region)), represent(pieces_of(law, region), saturations=True)
    assert saturated.inc.q == 2 and not saturated.inc.W.any() and one.inc.q == 1
    y = np.linspace(-9, 9, 41)[None]
    for each in (saturated, one):
        np.testing.assert_allclose(each.inc(y), np.clip(-0.8 * y, -1, 1), atol=1e-14)
    nothing = represent([(Box([0.0], [1.0]), [[0.0]], [0.0]), (Box([1.0], [2.0]), [[0.0]], [0.0])])
    assert nothing.inc.q == 0 and nothing.laws == (1,)


def test_kinks_of_a_scalar_function_are_its_units():
    knots, values = np.array([-3.0, -1.0, 0.0, 0.5, 2.0, 4.0]), np.array([1.0, 0.0, 2.0, -1.0, -1.0, 3.0])
    slope = np.diff(values) / np.diff(knots)
    pieces = [(Box([knots[i]], [knots[i + 1]]), [[slope[i]]], [values[i] - slope[i] * knots[i]]) for i in (3, 0, 4, 1, 2)]
    found = represent(pieces)
    assert found.inc.q == 4
    y = np.linspace(-3, 4, 141)
    np.testing.assert_allclose(found.inc(y[None])[0], np.interp(y, knots, values), atol=1e-14)


def test_laws_that_return_take_a_max_min_form():
    # Three triangles with flat parts between them: 8 kinks, but 7 laws, since the flat parts are one.
    knots = np.arange(0.0, 9.0)
    pieces = [(Box([a], [a + 1]), [[[1.0], [-1.0], [0.0]][int(a) % 3]],
               [[-a, a + 1.0, 0.0][int(a) % 3]]) for a in knots]
    found = represent(pieces)
    assert found.laws == (7,) and found.inc.q == 6 and found.forms == ("max-min",)
    np.testing.assert_allclose(found.inc(np.arange(0, 9.5, 0.5)[None])[0],
                               np.interp(np.arange(0, 9.5, 0.5), knots, np.array([0, 1, 0] * 3, float)), atol=1e-14)


def test_outputs_that_combine_others_take_no_units():
    law, region = net(3, 2, 3, 3, 2)
    M, F, f = np.array([[1.0, 0.0], [-2.0, 0.5], [0.0, 1.0]]), np.zeros((3, 2)), [0.0, 0.7, 0.0]
    F[1] = [0.3, -1.0]
    wide = INC(law.W, law.U, M @ law.V, M @ law.K + F, law.b, M @ law.d + f, law.activation)
    two, three = represent(pieces_of(law, region)), represent(pieces_of(wide, region))
    assert three.inc.q == two.inc.q and sorted(three.forms).count("shared") == 1
    assert largest_difference(wide, three.inc, region).value < 1e-12


def test_outputs_share_hyperplanes():
    law, region = net(5, 2, 4, 3)
    assert represent(pieces_of(law, region)).inc.q == 4


def test_units_do_not_depend_on_the_units_of_measurement():
    law, region = net(2, 2, 4, 3, 1)
    pieces = pieces_of(law, region)
    scale, shift = np.array([1e5, 1e-4]), np.array([3e5, -2e-4])
    moved = [(Polytope.from_vertices(scale[:, None] * pieces.polytope(i).vertices + shift[:, None]), pieces.G[i] / scale,
              pieces.g[i] - pieces.G[i] @ (shift / scale)) for i in range(len(pieces))]
    here, there = represent(pieces), represent(moved)
    x = region.sample(500, np.random.default_rng(0))
    np.testing.assert_allclose(there.inc(scale[:, None] * x + shift[:, None]), law(x), atol=1e-10)
    assert there.inc.q == here.inc.q and there.pieces == here.pieces


def test_pieces_may_overlap_where_they_agree():
    found = represent([LEFT, RIGHT, (Box([1.0], [4.0]), [[1.0]], [0.0])])
    assert found.inc.q == 1 and found.inc([4.0]).tolist() == [4.0]
    with pytest.raises(InvalidInputError, match=r"pieces 1 and 2 meet at y = \[3\.0\], where output 0 jumps by 2"):
        represent([LEFT, RIGHT, (Box([1.0], [4.0]), [[2.0]], [-1.0])])


def test_a_jump_is_refused_with_pieces_point_and_size():
    def parts(last):
        return [(Box([0.0, 0.0], [1.0, 2.0]), [[1.0, 0.0]], [0.0]), (Box([1.0, 0.0], [2.0, 1.0]), [[0.0, 0.0]], [1.0]),
                (Box([1.0, 1.0], [2.0, 2.0]), [[0.0, last]], [1.0 - last])]
    with pytest.raises(InvalidInputError, match=r"pieces 0 and 2 meet at y = \[1\.0, 2\.0\], where output 0 jumps by 0\.5"):
        represent(parts(0.5))
    assert represent(parts(0.0)).inc.q == 1


def test_tol_decides_what_is_rounding_and_error_tells_what_it_costs():
    pieces = [LEFT, (Box([0.0], [3.0]), [[1.0]], [1e-4])]
    with pytest.raises(InvalidInputError, match="jumps by 0.0001, more than tol"):
        represent(pieces)
    found = represent(pieces, tol=2e-4)
    y = np.linspace(1e-9, 3, 50)
    away = np.abs(found.inc(y[None])[0] - y - 1e-4).max()
    assert found.jump == pytest.approx(1e-4) and away <= found.error <= 2e-4


@pytest.mark.parametrize("pieces, point", [
    ([LEFT, (Box([0.5], [3.0]), [[1.0]], [0.0])], r"\[0\.[0-4]"),
    ([(Box([0.0, 0.0], [1.0, 2.0]), [[1.0, 0.0]], [0.0]), (Box([1.0, 0.0], [2.0, 1.0]), [[1.0, 0.0]], [0.0])],
     r"\[1\.[3-9]"),
])
def test_a_gap_and_a_union_that_is_not_convex_are_refused(pieces, point):
    with pytest.raises(InvalidInputError, match=rf"must fill a convex set, but y = {point}.*a gap, or their union is not"):
        represent(pieces)


def test_a_region_that_is_missing_is_noticed():
    law, region = net(4, 2, 4, 4, 1)
    pieces = pieces_of(law, region)
    kept = [(pieces.polytope(i), pieces.G[i], pieces.g[i]) for i in range(len(pieces))]
    assert represent(kept).inc.q == represent(pieces).inc.q
    smallest = int(pieces.volumes.argmin())
    assert pieces.volumes[smallest] < 0.01 * region.volume
    with pytest.raises(InvalidInputError, match="must fill a convex set"):
        represent(kept[:smallest] + kept[smallest + 1:])


def test_bad_input_is_refused_at_the_door():
    law, region = net(4, 2, 4, 4, 1)
    for pieces, message in (([], "at least one"), (3, "must be what"), ([LEFT, LEFT[:2]], "piece 1 must be"),
                            ([LEFT, ([0.0, 1.0], [[1.0]], [0.0])], "piece 1 must be"),
                            ([LEFT, (RIGHT[0], [[np.nan]], [0.0])], "gain of piece 1"),
                            (regions(Plant(np.eye(2), np.ones((2, 1))), law, region, pieces=3), "not complete")):
        with pytest.raises(InvalidInputError, match=message):
            represent(pieces)
    with pytest.raises(DimensionError, match="gain of piece 1"):
        represent([LEFT, (RIGHT[0], [[1.0, 0.0]], [0.0])])
    with pytest.raises(DimensionError, match="offset of piece 1"):
        represent([LEFT, (RIGHT[0], [[1.0]], [0.0, 1.0])])
    with pytest.raises(DimensionError, match="gain of piece 1 has shape"):
        represent([LEFT, (RIGHT[0], [[1.0], [2.0]], [0.0, 1.0])])
    with pytest.raises(InvalidInputError, match="tol = -1"):
        represent([LEFT, RIGHT], tol=-1.0)


def test_a_wrong_expression_never_comes_out(monkeypatch):
    module = importlib.import_module("inc_casadi.affine_pieces.represent")
    law, region = net(4, 2, 4, 4, 1)
    pieces = pieces_of(law, region)
    monkeypatch.setattr(module, "shortest_expression", lambda order, pairs: Gate("max", tuple(range(len(order)))))
    with pytest.raises(ConvergenceError, match="not right on every piece"):
        represent(pieces)
    monkeypatch.setattr(module, "fulfils", lambda expression, order: True)
    with pytest.raises(ConvergenceError, match="of the INC is off by"):
        represent(pieces)


def test_the_sentence_tells_the_count():
    assert represent([LEFT, RIGHT]).sentence == ("2 pieces with 2 affine laws, continuous but for 0, are an INC with 1 "
                                                 "hidden units (hinges), exact but for 0.")
