"""The nonnegative lengths past kinks: as functions of z, and the products of them that vanish."""

from fractions import Fraction

import multiplier_draws as md
import numpy as np
import pytest

from inc_casadi import Identity, LeakyReLU, ReLU, Saturation, Tanh, close_loop
from inc_casadi.activations import Pieces
from inc_casadi.multipliers import Relu
from inc_casadi.multipliers.atoms import atoms_of, bends, parts_of

UNITS = [ReLU(), LeakyReLU(0.3), md.CONCAVE, Saturation(), md.DEAD_ZONE, md.THREE]
RESTS = [0.0, -0.75, 0.5, 1.0, -1.0, 2.0, 3.5]


class FalseKink(ReLU):
    """A ReLU that names a kink at 2 where the slope stays as it is."""

    @property
    def pieces(self):
        return Pieces(np.array([0.0, 2.0]), np.array([0.0, 1.0, 1.0]), np.zeros(3))


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("rest", RESTS)
def test_rows_give_the_lengths_of_z_past_each_kink(unit, rest):
    # up_j is how far z is past kink j, down_j how far it is before it, each within its own stretch between kinks.
    parts = atoms_of(unit, Fraction(rest))
    z = np.concatenate([np.linspace(-4, 5, 73), unit.pieces.kinks, [rest]])
    deviations = np.vstack(
        [z - rest, unit(z) - unit(rest), *(md.further_columns(unit, z) - md.further_columns(unit, np.array([rest])))]
    )
    found = parts.rows.astype(float) @ deviations + parts.at_rest.astype(float)[:, None]
    kinks = unit.pieces.kinks
    up = md.lengths(unit, z)[0]
    down = [
        np.maximum(kinks[0] - z, 0),
        *(np.clip(high - z, 0, high - low) for low, high in zip(kinks, kinks[1:], strict=False)),
    ]
    np.testing.assert_allclose(found, np.vstack([up, *down]), atol=1e-12)
    assert parts.kinks == len(kinks) and parts.extras == len(kinks) - 1


def test_a_kink_without_a_bend_is_none():
    assert (
        bends(FalseKink()) == ([Fraction(0)], [Fraction(0), Fraction(1)]) and atoms_of(FalseKink(), Fraction(1)).kinks == 1
    )
    assert atoms_of(Identity(), Fraction(0)) is None and atoms_of(LeakyReLU(1.0), Fraction(0)) is None
    assert bends(Tanh()) is None and atoms_of(Tanh(), Fraction(0)) is None


@pytest.mark.parametrize("seed", range(6))
def test_which_products_vanish_everywhere(seed):
    # Exactly those that vanish on dense samples of independent units, and each partner is one of them.
    rng = np.random.default_rng(seed)
    units = tuple(np.array(UNITS, dtype=object)[rng.permutation(6)[:4]])
    rest = [float(rng.choice(RESTS)) for _ in units]
    plant, inc = md.square_loop(rng, units, dyadic=True, rest=rest)
    wide = Relu().widened(close_loop(plant, inc))
    assert wide.about == "rest" and [float(level) for level in wide.center] == rest
    x = md.states_at(plant, inc, md.levels(units, rng, 4000) * 1.5, rng)
    at_rest = np.linalg.solve(np.eye(plant.n) - plant.A, plant.B @ rest_input(plant, inc, rest))
    s = md.stack(plant, inc, x, columns=True, rest=at_rest)
    parts = parts_of(wide)
    h, g = parts.h @ s, parts.g @ s + parts.g_rest.astype(float)[:, None]
    assert h.min() >= -1e-12 and g.min() >= -1e-12 and np.all(parts.g_rest > 0)
    for products, vanish in ((h @ h.T, parts.excluded_hh), (h @ g.T, parts.excluded_hg)):
        assert np.array_equal(products < 1e-9, vanish)
    assert [i for i in range(len(h)) if parts.partner[i] >= 0] == list(np.flatnonzero(parts.excluded_hg.any(axis=1)))
    assert all(parts.excluded_hg[i, j] for i, j in enumerate(parts.partner) if j >= 0)


def rest_input(plant, inc, rest):
    """The input at rest (m,), from the levels at rest and the states that follow: u = K C x + V eta + d."""
    eta = md.values_of(inc.activations, np.array(rest)[:, None])[:, 0]
    x = np.linalg.solve(np.eye(plant.n) - plant.A - plant.B @ inc.K @ plant.C, plant.B @ (inc.V @ eta + inc.d))
    return inc.K @ plant.C @ x + inc.V @ eta + inc.d
