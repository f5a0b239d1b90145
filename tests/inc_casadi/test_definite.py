"""Verdicts by floating point against verdicts by fractions: never wrong, undecided only where rounding is in the way."""

import time
from itertools import product

import numpy as np
import pytest

from inc_casadi import definite, exact
from inc_casadi.blocks import exact as fractions
from inc_casadi.definite import definiteness, is_surely_not, is_surely_positive
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.readings import Rational, Rounded


def with_spectrum(rng, values):
    Q = np.linalg.qr(rng.normal(size=(len(values), len(values))))[0]
    M = Q * values @ Q.T
    return (M + M.T) / 2


def rescaled(M, D):
    M = D[:, None] * M * D
    return Rounded.lift(np.tril(M) + np.tril(M, -1).T)


def within(value, error):
    """A reading of `value` that may be off by `error` in each entry, up to a rounding."""
    value = np.asarray(value, dtype=float)
    return Rounded(value, np.abs(value), 0, error / 2)


def formed(kind, A, X, B):
    """X'AX up to cancellation: B B' comes and goes."""
    G = kind.lift(B) @ B.T
    return kind.lift(X).T @ kind.lift(A) @ X + G - 0.1 * G - 0.9 * G


@pytest.mark.parametrize("size", [1, 2, 7, 23])
def test_formed_with_rounding_the_verdict_is_that_of_fractions(size):
    rng = np.random.default_rng(61)
    decided = 0
    for power in range(0, 18):
        for sign in (1.0, -1.0):
            A = with_spectrum(rng, np.r_[sign * 10.0**-power, rng.uniform(1, 2, size=size - 1)])
            X, B = rng.normal(size=(size, size)), rng.normal(size=(size, size + 2))
            truth = exact.is_positive_definite(formed(Rational, A, X, B).numbers)
            verdict = definiteness(formed(Rounded, A, X, B))
            assert verdict is None or verdict == truth
            decided += verdict is not None
            assert power > 6 or verdict is not None
    assert decided < 36  # the last powers are beyond what rounding allows


@pytest.mark.parametrize("size", [5, 40])
def test_stored_numbers_are_decided_close_to_the_edge(size):
    rng = np.random.default_rng(62)
    for _ in range(5):
        small = 10 * size**2 * np.finfo(float).eps
        assert is_surely_positive(Rounded.lift(with_spectrum(rng, np.r_[small, np.ones(size - 1)])))
        assert is_surely_not(Rounded.lift(with_spectrum(rng, np.r_[-small, np.ones(size - 1)])))


def test_every_matrix_within_the_bound_is_meant():
    rng = np.random.default_rng(63)
    counts = {True: 0, False: 0, None: 0}
    signs = np.array(list(product((-1, 0, 1), repeat=6)))
    corners = np.zeros((len(signs), 3, 3))
    for k, (i, j) in enumerate(zip(*np.triu_indices(3), strict=True)):
        corners[:, i, j] = corners[:, j, i] = 0.999 * signs[:, k]
    for _ in range(200):
        value = with_spectrum(rng, np.array([rng.uniform(-0.5, 0.5), 1.0, 1.5]))
        error = 10.0 ** rng.uniform(-3, -0.5)
        verdict = definiteness(within(value, error))
        counts[verdict] += 1
        positive = np.linalg.eigvalsh(value + error * corners)[:, 0] > 0
        assert verdict is None or np.all(positive == verdict)
    assert min(counts.values()) > 20


def test_a_bound_by_hand():
    M = np.array([[1.0, 0.5], [0.5, 1.0]])  # with errors e the least eigenvalue is 0.5 - 2 e
    assert is_surely_positive(within(M, 0.2)) and not is_surely_positive(within(M, 0.25))
    N = np.array([[1.0, 1.5], [1.5, 1.0]])  # and here the greatest least one is -0.5 + 2 e
    assert is_surely_not(within(N, 0.24)) and not is_surely_not(within(N, 0.25))
    assert definiteness(within(M, 0.3)) is None and definiteness(within(N, 0.3)) is None


def nearly_singular(rng, size):
    """Stored doubles whose smallest eigenvalue is a rounding error of either sign."""
    root = rng.normal(size=(size, size - 1))
    M = root @ root.T
    return (M + M.T) / 2


def test_plain_cholesky_is_fooled_and_this_is_not():
    rng = np.random.default_rng(64)
    fooled = 0
    for _ in range(60):
        M = nearly_singular(rng, 6)
        truth = exact.is_positive_definite(fractions(M))
        try:
            fooled += bool(np.linalg.cholesky(M).size) and not truth
        except np.linalg.LinAlgError:
            pass
        assert definiteness(Rounded.lift(M)) in (None, truth)
    assert fooled > 3


def test_the_factor_runs_to_its_end_only_on_positive_matrices(monkeypatch):
    # Rump's theorem alone: with the residual waved through, the shift c must still refuse.
    monkeypatch.setattr(definite, "_remainder_is_dominant", lambda A, E, L: True)
    rng = np.random.default_rng(65)
    for size in (2, 6, 12):
        for _ in range(20):
            M = nearly_singular(rng, size)
            assert exact.is_positive_definite(fractions(M)) or not is_surely_positive(Rounded.lift(M))
    assert is_surely_positive(Rounded.lift(np.eye(3)))


def test_a_library_that_computes_nonsense_proves_nothing(monkeypatch):
    rng = np.random.default_rng(66)
    indefinite, positive = (with_spectrum(rng, np.array([least, 1.0, 2.0])) for least in (-1e-3, 1e-3))
    for scale in (0.0, 1e-6, 0.1, 1.0, 1e3, np.inf, np.nan):
        with np.errstate(invalid="ignore"):
            nonsense = scale * rng.normal(size=(3, 3))
        monkeypatch.setattr(np.linalg, "cholesky", lambda M, out=nonsense: out)
        monkeypatch.setattr(np.linalg, "eigh", lambda M, out=nonsense: (np.zeros(3), out))
        assert not is_surely_positive(Rounded.lift(indefinite))
        assert not is_surely_not(Rounded.lift(positive))
    monkeypatch.undo()
    close = np.linalg.cholesky(indefinite + 1.001e-3 * np.eye(3))  # a factor, but of another matrix close by
    monkeypatch.setattr(np.linalg, "cholesky", lambda M: close)
    assert not is_surely_positive(Rounded.lift(indefinite))


def test_the_remainder_is_judged_with_every_doubt_counted():
    dominant, one = definite._remainder_is_dominant, np.eye(2)
    half = np.diag(np.sqrt([0.5, 0.5]))  # I - L L' = I / 2
    assert dominant(one, np.full((2, 2), 0.24), half) and not dominant(one, np.full((2, 2), 0.26), half)
    coupled = one + 0.2 * one[::-1]
    assert dominant(coupled, np.full((2, 2), 0.14), half) and not dominant(coupled, np.full((2, 2), 0.16), half)
    eps, no_error = np.finfo(float).eps, np.zeros((2, 2))
    assert not dominant((1 + 4 * eps) * one, no_error, one)  # what is left is no more than L L' may be off
    assert dominant((1 + 40 * eps) * one, no_error, one) and not dominant(0.4 * one, no_error, half)


def test_a_solver_that_fails_leaves_it_undecided(monkeypatch):
    def fail(M):
        raise np.linalg.LinAlgError("no convergence")
    monkeypatch.setattr(np.linalg, "eigh", fail)
    assert definiteness(Rounded.lift(np.array([[1.0, 2.0], [2.0, 1.0]]))) is None


@pytest.mark.parametrize("unit", [1e-200, 1e-140, 1e-3, 1e140])
def test_units_do_not_matter(unit):
    rng = np.random.default_rng(67)
    M = with_spectrum(rng, np.array([1e-5, 0.5, 1.0, 2.0]))
    for D in (np.full(4, np.sqrt(unit)), np.sqrt([unit, 1.0, 1.0 / unit, 3.0])):
        assert definiteness(rescaled(M, D)) is True
        assert definiteness(-rescaled(M, D)) is False
        indefinite = M - 2e-5 * np.eye(4)
        assert definiteness(rescaled(indefinite, D)) is False


def test_tiny_products_are_decided_or_left_open_but_never_wrong():
    assert definiteness(Rounded.lift(np.array([[1e-200]])) @ np.array([[1.0]])) is True
    assert definiteness(Rounded.lift(np.array([[1e-200]])) @ np.array([[-1.0]])) is False
    assert definiteness(Rounded.lift(np.array([[1e-200]])) @ np.array([[1e-200]])) is None
    lost = Rounded.lift(np.array([[1e-200]])) @ np.array([[-1e-200]])  # -1e-400, which reads as -0.0
    assert definiteness(lost) is None and definiteness(lost + 1.0) is True
    assert definiteness(lost + 1e-310) is None
    assert definiteness(Rounded.lift(np.array([[1e-200, 1e-250], [1e-250, 1e-201]])) * 3.0) is True


def test_overflow_and_nan_are_undecided():
    for entry in (np.inf, np.nan):
        assert definiteness(Rounded.lift(np.array([[1.0, 0.0], [0.0, entry]]))) is None
    huge = Rounded(np.eye(2), np.full((2, 2), np.inf), 3)
    assert definiteness(huge) is None
    assert definiteness(Rounded.lift(np.array([[1e-300, 1e300], [1e300, 1e-300]]))) is None


def test_on_the_edge_and_without_rows():
    assert definiteness(Rounded.lift(np.zeros((2, 2)))) is None
    assert definiteness(Rounded.lift(np.array([[1.0, 1.0], [1.0, 1.0]]))) is None
    assert definiteness(Rounded.lift(np.diag([1.0, 0.0]))) is None
    assert definiteness(Rounded.lift(np.zeros((0, 0)))) is True


def test_what_is_not_a_symmetric_matrix_is_an_error():
    for judge in (is_surely_positive, is_surely_not, definiteness):
        with pytest.raises(DimensionError, match=r"square matrix, but the shape is \(2, 3\)"):
            judge(Rounded.lift(np.ones((2, 3))))
        with pytest.raises(InvalidInputError, match=r"entry \(0, 1\) is 0.25 and entry \(1, 0\) is 0"):
            judge(Rounded.lift(np.array([[1.0, 0.25], [0.0, 1.0]])))
    rounded = Rounded(np.array([[1.0, 0.25], [0.25 + 1e-14, 1.0]]), np.ones((2, 2)), 60)
    assert is_surely_positive(rounded)  # both halves are readings of the same exact numbers


def test_milliseconds():
    rng = np.random.default_rng(68)
    for size, seconds in ((74, 0.02), (200, 0.1)):
        M = Rounded.lift(with_spectrum(rng, np.linspace(1e-6, 1.0, size)))
        for reading, verdict in ((M, True), (-M, False), (M - 2e-6 * np.eye(size), False)):
            best = np.inf
            for _ in range(3):
                start = time.perf_counter()
                assert definiteness(reading) is verdict
                best = min(best, time.perf_counter() - start)
            assert best < seconds
