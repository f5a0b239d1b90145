"""The exact value is below every admissible cost in exact arithmetic, and next to the one in floats."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import Box, Ellipsoid, Empirical, Moments, Plant, Polytope, Spec
from inc_casadi.blocks import exact
from inc_casadi.bounds import affine_moves, first_move
from inc_casadi.bounds.exact_anchors import Span, nearly_flat, on_anchors
from inc_casadi.bounds.frame import Frame
from inc_casadi.bounds.measured import measured_rows
from inc_casadi.bounds.value_iteration import unlimited

N, M, P = 3, 2, 1
BOX = Box([-1.0, -0.5, -2.0], [1.5, 0.5, 1.0])
POINTS = np.random.default_rng(8).standard_normal((N, 7))
INITIAL = {
    "box": BOX, "polytope": Polytope.from_vertices(POINTS), "ellipsoid": Ellipsoid(np.eye(3) + 0.3, [0.2, -0.1, 0.3]),
    "empirical": Empirical(POINTS, np.arange(1, 8)), "moments": Moments(BOX, [0.1, 0, -0.4], 0.1 * np.eye(3) + 0.02),
    "plane": Empirical([[1.0, 0.0, -1.0, 0.5], [0.0, 1.0, -1.0, 0.25], [1.0, 1.0, -2.0, 0.75]]),
    "one state": Empirical([[1.0], [-0.5], [2.0]]),
}
LIMITS = {"box": Box([-0.3, -0.5], [0.4, 0.2]), "triangle": Polytope([[-1, 0], [0, -1], [1, 1.3]], [0.3, 0.2, 0.5])}


def draw(seed, initial, inputs="box", r=1.0, full=False):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((N, N))
    A *= 1.03 / np.max(np.abs(np.linalg.eigvals(A)))
    short = rng.standard_normal((N, N))
    spec = Spec(short @ short.T, r * np.diag([0.1, 0.3]), 0.9, INITIAL[initial], LIMITS[inputs])
    return Plant(A, rng.standard_normal((N, M)), C=None if full else rng.standard_normal((P, N))), spec


@pytest.mark.parametrize("full", [False, True], ids=["output", "state"])
@pytest.mark.parametrize("r", [0.0, 1.0])
@pytest.mark.parametrize("initial", INITIAL)
def test_it_is_proved_and_near_the_value_in_floats(initial, r, full):
    plant, spec = draw(1, initial, r=r, full=full)
    bound = affine_moves(plant, spec, 5)
    assert bound.value <= bound.exact_value() < bound.value * (1 + 1e-9)
    assert bound.holds() and bound.prove() and "exact rational" in bound.prove().method


@pytest.mark.parametrize("initial", ["box", "plane"])
def test_it_is_proved_with_a_polytope_of_inputs(initial):
    bound = affine_moves(*draw(2, initial, "triangle"), 4)
    assert bound.holds() and bound.prove() and bound.exact_value() < bound.value * (1 + 1e-9)


@pytest.mark.parametrize("moves", [1, 8, 20])
def test_it_is_proved_on_the_two_state_plant(moves):
    spec = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box(-1, 1))
    for C in (None, [[1.0, 0.3]]):
        bound = affine_moves(Plant([[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]], C), spec, moves)
        assert bound.prove().succeeded and bound.exact_value() - Fraction(bound.value) < 1e-9


@pytest.mark.parametrize("discount", [0.05, 0.5, 0.98, 1.0])
def test_it_does_not_exceed_the_true_minimum_as_a_fraction(discount):
    bound = first_move(Plant(1.5, 1.0), Spec(1.0, 0.0, discount, Box(-1, 1), Box(-1, 1)))
    true = Fraction(1, 3) + Fraction(discount) / 12
    assert true - Fraction(1, 10**9) < bound.exact_value() <= true


def exact_cost(plant, spec, U):
    """E cost of u_k = U_k [x_0; 1] over finitely many points, the last state included, step by step in Fractions."""
    A, B, Q, R, beta = exact(plant.A), exact(plant.B), exact(spec.Q), exact(spec.R), Fraction(spec.discount)
    weights = exact(spec.initial.weights)
    total = Fraction(0)
    for weight, x in zip(weights / weights.sum(), exact(spec.initial.points).T, strict=True):
        start = np.append(x, Fraction(1))
        for k, map_ in enumerate(U):
            u = map_ @ start
            total += weight * beta**k * (x @ Q @ x + u @ R @ u)
            x = A @ x + B @ u
        total += weight * beta ** len(U) * (x @ Q @ x)
    return total


@pytest.mark.parametrize("initial, full", [("empirical", True), ("empirical", False), ("plane", True), ("one state", False)])
def test_no_admissible_moves_cost_less(initial, full):
    plant, spec = draw(3, initial, full=full)
    bound = affine_moves(plant, spec, 2, time_varying=True)
    rows = [np.eye(N)] * 2 if full else [plant.C, np.vstack([plant.C, plant.C @ plant.A])]
    rng, points = np.random.default_rng(4), exact(spec.initial.points)
    lower, upper = exact(spec.inputs.lower)[:, None], exact(spec.inputs.upper)[:, None]
    middle, low = (lower + upper) / 2, bound.exact_value()
    for trial in range(20):
        U = []
        for k, row in enumerate(rows):
            near = np.linalg.lstsq(row.T, bound.moves[k][:, :-1].T, rcond=None)[0].T
            linear = exact(near + trial * 0.03 * rng.standard_normal((M, len(row)))) @ exact(row)
            values = linear @ points + exact(bound.moves[k][:, -1:])
            excess = np.max(np.abs(values - middle) / (upper - middle))
            shrink = 1 / max(excess, 1)  # toward the middle until every limit is kept exactly
            U.append(np.hstack([shrink * linear, middle + shrink * (exact(bound.moves[k][:, -1:]) - middle)]))
            at = U[-1] @ np.vstack([points, np.ones(points.shape[1], dtype=int)])
            assert np.all(np.abs(at - middle) <= upper - middle)
        cost = exact_cost(plant, spec, U)
        assert cost >= low
        assert trial or cost < low * Fraction(1 + 1e-4)


@pytest.mark.parametrize("inputs", LIMITS)
def test_any_numbers_prove_something_lower_and_exactly_that(inputs):
    bound = affine_moves(*draw(2, "box", inputs), 5)
    rng = np.random.default_rng(0)
    for scale in (1e-3, 1e-1):
        multipliers = bound.multipliers * np.exp(scale * rng.standard_normal(bound.multipliers.size))
        for worse in (replace(bound, multipliers=multipliers),
                      replace(bound, moves=bound.moves + scale * rng.standard_normal(bound.moves.shape))):
            value, allowance = worse.dual()
            assert not worse.prove() and "below the stated one" in worse.prove().reason
            assert value - allowance <= worse.exact_value() <= value + allowance < bound.value
            assert replace(worse, value=value - allowance).prove()


def corrupted(bound):
    cuts = bound.cuts
    yield "value", replace(bound, value=bound.value + 1e-6)
    yield "negative multiplier", replace(bound, multipliers=bound.multipliers - 1e-12)
    yield "no number", replace(bound, multipliers=np.full_like(bound.multipliers, np.nan))
    yield "infinite", replace(bound, moves=np.full_like(bound.moves, np.inf))
    outside = np.where(cuts.point > 0, np.nextafter(cuts.point, 9), np.nextafter(cuts.point, -9))
    yield "cut a rounding unit outside", replace(bound, cuts=replace(cuts, point=outside))
    yield "anchor outside", replace(bound, anchors=1.001 * bound.anchors)
    yield "move that is not there", replace(bound, cuts=replace(cuts, move=cuts.move + 1))
    yield "move before the first", replace(bound, cuts=replace(cuts, move=cuts.move - 1))
    yield "half-space that is not there", replace(bound, cuts=replace(cuts, facet=cuts.facet + 1))
    yield "missing multiplier", replace(bound, multipliers=bound.multipliers[1:])
    yield "wider limits", replace(bound, spec=replace(bound.spec, inputs=Box([-0.6, -0.9], [0.8, 0.4])))
    yield "another plant", replace(bound, plant=Plant(0.9 * bound.plant.A, bound.plant.B, bound.plant.C))


CORRUPTED = dict(corrupted(affine_moves(*draw(1, "box"), 4)))


@pytest.mark.parametrize("bound", CORRUPTED.values(), ids=CORRUPTED)
def test_corrupted_numbers_are_refused(bound):
    assert not bound.holds() and not bound.prove() and bound.prove().reason


def test_more_measurements_than_the_bound_was_made_for_are_refused():
    plant, spec = draw(1, "box")
    bound = affine_moves(plant, spec, 4)
    assert not replace(bound, relaxed=True).holds() and not replace(bound, relaxed=True).prove()


def test_a_cut_on_a_move_before_the_first_cannot_raise_it():
    # With u in [1, 2] a half-space has h = -1: counted, but tied to no move, its multiplier would add to the value.
    bound = first_move(Plant(1.5, 1.0), Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(1, 2)))
    k = len(bound.multipliers)
    facet, point = np.append(bound.cuts.facet, 1), np.hstack([bound.cuts.point, [[1.0]]])
    for move in (-1, 1):
        cuts = replace(bound.cuts, move=np.append(bound.cuts.move, move), facet=facet, point=point)
        forged = replace(bound, cuts=cuts, multipliers=np.append(bound.multipliers, 5.0), value=bound.value + 4.0)
        assert len(forged.multipliers) == k + 1 and not forged.holds() and not forged.prove()


def test_states_that_leave_a_plane_by_rounding_are_refused_afterwards_too():
    bound = affine_moves(*draw(1, "plane", full=True), 3)
    off = np.array([[0.0], [0.0], [1e-15]]) * (bound.anchors[0] == 0.5)
    points = INITIAL["plane"].points + np.array([[0.0], [0.0], [1e-15]]) * (INITIAL["plane"].points[0] == 0.5)
    cuts = replace(bound.cuts, point=bound.cuts.point + np.array([[0.0], [0.0], [1e-15]]) * (bound.cuts.point[0] == 0.5))
    moved = replace(bound, spec=replace(bound.spec, initial=Empirical(points)), anchors=bound.anchors + off, cuts=cuts)
    assert not moved.holds() and "within rounding of a hyperplane" in moved.prove().reason


def test_the_allowance_counts_the_rounded_vertices_of_a_polytope_of_inputs():
    plant, spec = draw(2, "box")
    bound = affine_moves(plant, spec, 2)
    without = replace(bound, multipliers=np.zeros(bound.multipliers.size))  # so that all rests on the limits' vertices
    listed = replace(without, spec=replace(spec, inputs=Polytope(spec.inputs.H, spec.inputs.h)))
    assert without.dual()[0] == pytest.approx(listed.dual()[0], rel=1e-12) and without.dual()[0] < bound.value - 0.1
    assert listed.dual()[1] - without.dual()[1] > 1e-13


@pytest.mark.parametrize("shape", [[1.0, 3.0, 1e9], [1e-6, 1.0, 1.0], [1.0, 1.0, 1e12]])
def test_a_thin_ellipsoid_s_covariance_is_not_trusted_beyond_its_rounding(shape):
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((N, N)))[0]
    plant, spec = draw(2, "box")
    bound = affine_moves(plant, replace(spec, initial=Ellipsoid(turn @ np.diag(shape) @ turn.T)), 2)
    assert bound.value > 0 and bound.holds() and bound.prove()
    free = unlimited(bound.plant, bound.spec, 3)
    assert free.holds() and free.prove()


def test_anchors_that_do_not_span_the_states_are_refused():
    bound = affine_moves(*draw(1, "box", full=True), 3)
    few = replace(bound, anchors=bound.anchors[:, :3], value=-1e9)
    assert not few.prove() and "do not span" in few.prove().reason


def test_weights_that_are_indefinite_by_rounding_are_refused_with_the_reason():
    thin = np.array([[1.0, 1.0], [1.0, 1.0 - 2**-52]])
    spec = Spec(thin, 0.1, 0.9, Box([-1, -1], [1, 1]), Box(-1, 1))
    bound = affine_moves(Plant([[0.9, 0.2], [0.0, 0.8]], [[0.0], [1.0]]), spec, 2)
    assert "Q has a negative eigenvalue" in bound.prove().reason


def test_functions_are_written_on_anchors_exactly():
    plant, _ = draw(6, "box")
    rng, anchors = np.random.default_rng(1), BOX.vertices
    forces = [exact(rng.standard_normal((M, N + 1))) for _ in range(5)]
    rows = [np.vstack([plant.C @ np.linalg.matrix_power(plant.A, j) for j in range(k + 1)]) for k in range(5)]
    for k, (force, found) in enumerate(zip(forces, on_anchors(plant, anchors, forces), strict=True)):
        U = np.hstack([rng.standard_normal((M, k + 1)) @ rows[k], rng.standard_normal((M, 1))])
        at = U @ np.vstack([anchors, np.ones(8)])
        assert np.sum(found.astype(float) * at) == pytest.approx(np.sum(force.astype(float) * U), rel=1e-9)
        E, lifted = exact(np.eye(N + 1)), exact(np.vstack([anchors, np.ones(8)]))
        if k < 2:  # from k = 2 on the rows span everything
            E = np.full((k + 2, N + 1), Fraction(0), dtype=object)
            E[-1, -1] = Fraction(1)
            E[:-1, :-1] = [exact(plant.C)[0], exact(plant.C)[0] @ exact(plant.A)][:k + 1]
        assert np.all(found @ (E @ lifted).T == force @ E.T)
        float_N = Frame(measured_rows(plant, 5)[k], anchors).on_anchors(force.astype(float))
        np.testing.assert_allclose(found.astype(float), float_N, atol=1e-9)


def test_a_target_out_of_reach_is_none():
    span = Span(exact(np.array([[1.0, 2.0], [2.0, 4.0]])), [0, 1])
    assert span.coefficients(exact(np.array([[1.0], [2.0 + 1e-15]]))) is None
    assert span.coefficients(exact(np.array([[3.0], [6.0]]))).tolist() == [[Fraction(3)]]


@pytest.mark.parametrize("off, flat", [(0.0, False), (1e-16, True), (1e-13, True), (1e-6, False)])
def test_states_within_rounding_of_a_plane_are_refused(off, flat):
    from inc_casadi.errors import InvalidInputError

    plant, spec = draw(1, "plane", full=True)
    points = INITIAL["plane"].points + np.array([[0.0], [0.0], [1.0]]) * np.array([0, 0, 0, off])
    assert nearly_flat(plant, points, 2) == (flat and bool(np.any(points != INITIAL["plane"].points)))
    if nearly_flat(plant, points, 2):
        with pytest.raises(InvalidInputError, match="within rounding of a hyperplane"):
            affine_moves(plant, replace(spec, initial=Empirical(points)), 2)
    else:
        assert affine_moves(plant, replace(spec, initial=Empirical(points)), 2).prove()
