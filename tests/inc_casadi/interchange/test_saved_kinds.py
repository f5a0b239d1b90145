"""Every dataclass of the public API can be saved: it comes back bit for bit, says the same, and holds as before."""

import typing
from dataclasses import is_dataclass
from fractions import Fraction
from functools import cache
from inspect import isabstract

import numpy as np
import pytest

import inc_casadi
from inc_casadi import (
    INC,
    MPC,
    Attraction,
    Box,
    DeviationCost,
    Ellipsoid,
    Empirical,
    Gaussian,
    InputSector,
    Invariance,
    L2Gain,
    Margins,
    Moments,
    NormBounded,
    Plant,
    Polytope,
    Polytopic,
    Regional,
    Robust,
    Spec,
    Stability,
    Tanh,
    Together,
    Uniform,
    activations,
    affine_pieces,
    bounds,
    certify,
    claims,
    compare,
    comparison,
    dynamic,
    linear,
    load,
    multipliers,
    save,
    sets,
    uncertainty,
)
from inc_casadi.activations.base import Activation
from inc_casadi.bounds import Bound, ScalarSeparation
from inc_casadi.bounds.cells import Cells
from inc_casadi.bounds.value_iteration import unlimited
from inc_casadi.certificate import Certificate
from inc_casadi.dynamic import certify_dynamic, corrected, observer
from inc_casadi.ellipsoidal_region import certify_ellipsoidal
from inc_casadi.estimate import estimate
from inc_casadi.interchange.checking import verdicts
from inc_casadi.interchange.encoding import encoded
from inc_casadi.interchange.kinds import KINDS, MAKERS
from inc_casadi.linear import LinearController, best_static_gain, clipped_cost, linear_cost, unswitched_cost
from inc_casadi.linear.dynamic_loop import started
from inc_casadi.pieces.critical_regions import CriticalRegions
from inc_casadi.sets import Distribution, Set

EXCEPTIONS = {
    "Basin": "thousands of cells with their motions, internals of a walk that is done again in seconds",
    "ReachableSets": "thousands of cells, internals of a walk that is done again in seconds",
    "ClosedLoop": "formed from plant and controller whenever it is needed",
    "FlatCertificate": "formed by a DynamicCertificate from what it holds",
    "WellPosedness": "recomputed from the controller, so that nobody has to believe it",
    "Pieces": "what an activation states of itself, given by its kind",
    "Unknown": "a description of a number that claims and multipliers ask for, given by their kind",
}
"""Dataclasses of the public API that no file holds, and why."""

PLANT, SCALAR = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]]), Plant(1.5, 1.0)
START, LIMITS, UNIT = Box([-0.8, -0.8], [0.8, 0.8]), Box([-1.0], [1.0]), Box(-1.0, 1.0)
SPEC, SHORT = Spec(np.eye(2), [[0.05]], 0.98, START, LIMITS), Spec(1.0, 0.1, 0.9, UNIT, LIMITS)
LAW, CLIPPED = INC.saturated([[-1.1, -2.0]], 1.0), INC.saturated([[-1.5]], 1.0)
WALK = Regional(START, LIMITS, SPEC.Q, SPEC.R, 0.98)
TRIANGLE = Polytope.from_vertices(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1 / 3]]))
MEASURED = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])
DYNAMIC = observer(MEASURED, [[2.0], [1.0]], corrected(INC.saturated([[-0.5, -1.2]], 0.5), [[1.0], [1.0]], MEASURED.C))
NARROW = Regional(Box([-1.0, -0.5], [1.0, 0.5]), Box([-0.5], [0.5]), np.eye(2), [[0.1]], 0.95)
FLAT = Spec(1.0, 0.1, 0.9, Gaussian([0.0], [[1.0]]))
POINTS = Spec(1.0, 0.1, 0.9, Empirical([[0.3, -0.7, 1.0]]), LIMITS)
ROUND = Spec(1.0, 0.1, 0.9, Ellipsoid([[1.0]]), LIMITS)
CORNER = Spec(np.eye(2), [[0.05]], 0.98, TRIANGLE, LIMITS)
HALF = {
    "clipped": CLIPPED,
    "gain": [[-1.0]],
    "function": lambda y: -np.clip(1.4 * y, -1, 1),
    "late": LinearController.static([[-0.9]]),
}

SAMPLES = {
    "bounds": lambda: (
        bounds.affine_moves(PLANT, SPEC, 3),
        bounds.first_move(SCALAR, SHORT),
        bounds.affine_moves(MEASURED, Spec(np.eye(2), 0.1, 0.95, START, LIMITS), 4),
        bounds.any_controller(PLANT, SPEC, cells=60),
        bounds.any_controller(SCALAR, POINTS, cells=20),
        bounds.any_controller(SCALAR, ROUND, cells=20),
        bounds.any_controller(PLANT, CORNER, cells=60),
        bounds.any_controller(SCALAR, Spec(1.0, 0.1, 0.9, UNIT)),
        bounds.any_output_feedback(MEASURED, SPEC, cells=60),
        bounds.any_output_feedback(MEASURED, Spec(np.eye(2), [[0.05]], 0.98, START)),
        unlimited(SCALAR, FLAT),
        bounds.static_output_feedback(SCALAR, SHORT, gap=0.05),
        bounds.static_output_feedback(PLANT, Spec(np.eye(2), [[0.05]], 0.9, START), gap=0.3),
        bounds.first_move(SCALAR, Spec(1.0, 0.0, 1.0, Moments(UNIT, [0.25], [[0.2]]), LIMITS)),
        ScalarSeparation(Fraction(9, 10), Fraction(1, 3)),
        ScalarSeparation(0.9),
    ),
    "certificates": lambda: (
        certify(SCALAR, CLIPPED, Attraction(LIMITS)),
        certify(PLANT, LAW, WALK),
        certify(SCALAR, CLIPPED, Invariance(UNIT, LIMITS)),
        certify(PLANT, INC.saturated([[-0.1, 0.0]], 1.0), WALK),
        certify(Plant(0.5, 1.0), CLIPPED, Stability(0.99)),
        certify_dynamic(MEASURED, DYNAMIC, NARROW),
        certify(Plant(0.9, 1.0), INC.from_layers([([[1.0]], [0.0]), ([[-0.3]], [0.0])], Tanh()), Attraction()),
        linear_cost(SCALAR, SHORT, LinearController([[0.1]], [[0.2]], [[0.0]], [[-0.9]], [0.3])),
        linear_cost(SCALAR, SHORT, LinearController.static([[0.0]])),
        unswitched_cost(SCALAR, SHORT, INC.saturated([[-1.0]], 1.0)),
        clipped_cost(SCALAR, SHORT, INC.saturated([[-1.2]], 1.0)),
        certify(Plant(1.2, 1.0), INC([[0.0]], [[1.0]], [[-0.6]], [[-0.4]]), Regional(UNIT, None, [[1.0]], [[0.1]], 0.9)),
        certify_ellipsoidal(SCALAR, INC([[0.0]], [[1.6]], [[-1.0]], [[0.0]], activation=Tanh()), SHORT),
    ),
    "comparisons": lambda: (
        compare(SCALAR, SHORT, HALF),
        compare(SCALAR, SHORT, HALF, prove=True, bounds=["linear", "static"]),
    ),
    "controllers": lambda: (
        LAW,
        LinearController([[0.1]], [[0.2]], [[0.3]], [[0.4]], [0.5]),
        DYNAMIC,
        best_static_gain(SCALAR, SHORT),
        MPC(SCALAR, 1.0, 0.1, 3, LIMITS),
        CriticalRegions(MPC(SCALAR, 1.0, 0.1, 2, LIMITS)),
    ),
    "sets and claims": lambda: (
        Moments(START, [0.1, 0.0], [[0.25, 0.1], [0.1, 0.2]]),
        Moments(Ellipsoid(np.eye(2)), [0, 0], 0.1 * np.eye(2)),
        started(Uniform(UNIT), LinearController([[0.1]], [[0.2]], [[0.3]], [[0.4]], [0.5])),
        Uniform(TRIANGLE),
        Polytopic(Robust(Stability(), InputSector.disk(0.1)), (PLANT,)),
        FLAT,
        POINTS,
        Together((Stability(0.9), Robust(Stability(0.9), NormBounded([[1.0], [0.0]], [[1.0, 0.0]])))),
        Margins(),
        L2Gain([[1.0], [0.0]]),
        DeviationCost(np.eye(2), [[0.1]], 0.9, START),
    ),
    "answers": lambda: (
        inc_casadi.simulate(PLANT, LAW, [0.1, 0.2], steps=3),
        inc_casadi.equilibrium(PLANT, LAW),
        estimate(SCALAR, CLIPPED, SHORT, samples=50),
        estimate(Plant(3.0, 1.0), CLIPPED, SHORT, samples=50),
        inc_casadi.admissible_set(PLANT, LAW, LIMITS, START),
        inc_casadi.regions(PLANT, LAW, START),
        inc_casadi.largest_difference(CLIPPED, INC.saturated([[-1.4]], 1.0), UNIT),
        inc_casadi.largest_scale(SCALAR, CLIPPED, Regional(UNIT, LIMITS, [[1.0]], [[0.1]]), tolerance=0.3),
        affine_pieces.represent([(Box([-2.0], [0.0]), [[-1.0]], [0.0]), (Box([0.0], [2.0]), [[1.0]], [0.0])]),
        dynamic.folded(MEASURED, DYNAMIC, NARROW, Box([-9.0, -9.0], [9.0, 9.0])),
        certify(Plant(0.5, 1.0), CLIPPED, Stability(0.99)).prove(),
    ),
    "activations and rungs": lambda: (
        *(kind() for kind in KINDS if issubclass(kind, Activation) and kind.__name__ != "TwoSlopes"),
        activations.TwoSlopes(-0.3, 1 / 3),
        multipliers.Sector(),
        multipliers.Slope(),
        multipliers.Relu(),
        multipliers.Lifted(2),
        inc_casadi.Budget(5, 6, 7.0),
    ),
}


@cache
def samples(group):
    return SAMPLES[group]()


def parts_of(value):
    """All dataclasses within a value, itself included."""
    if isinstance(value, dict):
        if set(value) == {"kind", "data"}:
            yield value["kind"]
        for entry in value.values():
            yield from parts_of(entry)
    elif isinstance(value, list):
        for entry in value:
            yield from parts_of(entry)


def again(noun, folder):
    save(noun, folder / "noun.json")
    return load(folder / "noun.json")


@pytest.mark.parametrize("group", SAMPLES)
def test_everything_comes_back_bit_for_bit(group, tmp_path):
    for noun in samples(group):
        back = again(noun, tmp_path)
        assert type(back) is type(noun) and encoded(back) == encoded(noun)
        assert arrays_are_frozen(back)


def arrays_are_frozen(noun):
    return all(not value.flags.writeable for value in vars(noun).values() if isinstance(value, np.ndarray))


@pytest.mark.parametrize("group", ["bounds", "certificates", "comparisons", "answers"])
def test_what_is_stated_is_stated_as_before(group, tmp_path):
    for noun in samples(group):
        back = again(noun, tmp_path)
        assert str(back) == str(noun)
        for name in ("sentence", "statement", "bound", "reason"):
            value = getattr(noun, name, None)
            if isinstance(value, str | float):
                assert getattr(back, name) == value
        if hasattr(noun, "holds"):
            assert back.holds() == noun.holds()
        if hasattr(noun, "margins"):
            assert dict(back.margins()) == dict(noun.margins())


@pytest.mark.parametrize("group", ["bounds", "certificates"])
def test_what_was_proved_is_proved_again(group, tmp_path):
    for noun in samples(group):
        if not isinstance(noun, Bound | Certificate):
            continue
        first, second = noun.prove(), again(noun, tmp_path).prove()
        assert (bool(first), first.method, first.reason) == (bool(second), second.method, second.reason)
    assert sum(bool(noun.prove()) for noun in samples(group) if hasattr(noun, "prove")) >= 7


def test_a_comparison_reopens_with_its_proofs_checkable(tmp_path):
    for noun in samples("comparisons"):
        back = again(noun, tmp_path)
        assert str(back) == str(noun) and back.to_rows() == noun.to_rows()
        assert [one.separates for one in back.statements] == [one.separates for one in noun.statements]
        assert {name: bool(proof) for name, proof in back.prove().items()} == {
            name: bool(proof) for name, proof in noun.prove().items()
        }
        back.require_consistent()
        found = list(verdicts(back))
        assert len(found) >= 5 and all(one.passed for one in found)


def test_a_function_is_named_where_it_cannot_be_kept(tmp_path):
    back = again(samples("comparisons")[0], tmp_path)
    assert back.row("function").controller == "a function named 'function', which no file can hold"


def test_what_is_said_alike_is_one_object(tmp_path):
    """The cells of an ellipsoid's bound must name the very distribution that they divide."""
    bound = samples("bounds")[5]
    back = again(bound, tmp_path)
    assert back.cells.initial is back.spec.initial and back.holds()


def public():
    """The dataclasses that the packages export, and those that their functions return."""
    packages = (
        inc_casadi,
        activations,
        affine_pieces,
        bounds,
        claims,
        comparison,
        dynamic,
        linear,
        multipliers,
        sets,
        uncertainty,
    )
    found = {}
    for package in packages:
        for name in package.__all__:
            thing = getattr(package, name)
            if callable(thing) and not isinstance(thing, type):
                thing = typing.get_type_hints(thing, include_extras=False).get("return")
            if isinstance(thing, type) and is_dataclass(thing) and not isabstract(thing):
                found[thing.__name__] = thing
    for base in (
        Certificate,
        Bound,
        Distribution,
        Set,
        claims.Claim,
        multipliers.Multiplier,
        uncertainty.Uncertainty,
        Activation,
        Cells,
    ):
        found |= {kind.__name__: kind for kind in descendants(base)}
    return found


def descendants(base):
    below = [kind for kind in base.__subclasses__() if kind.__module__.startswith("inc_casadi.")]
    whole = [kind for kind in below if is_dataclass(kind) and not isabstract(kind)]
    return whole + [deeper for kind in below for deeper in descendants(kind)]


def test_no_dataclass_of_the_public_api_is_missing_from_the_table():
    missing = sorted(name for name, kind in public().items() if kind not in KINDS and name not in EXCEPTIONS)
    assert not missing, f"add {missing} to inc_casadi.interchange.kinds.KINDS, or to EXCEPTIONS with the reason"
    assert len(public()) > 40 and not [name for name in EXCEPTIONS if name in {kind.__name__ for kind in KINDS}]


def test_every_kind_has_been_tried():
    tried = {kind for group in SAMPLES for noun in samples(group) for kind in parts_of(encoded(noun))}
    assert {kind.__name__ for kind in KINDS} - tried == set()


def test_kinds_have_names_of_their_own():
    assert len({kind.__name__ for kind in KINDS}) == len(KINDS) and set(MAKERS) <= set(KINDS)
