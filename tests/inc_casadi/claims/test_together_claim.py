"""Several claims with one P: each is true with it, none borrows another's multiplier."""

import draws
import numpy as np
import oracles
import pytest
import uncertain

from inc_casadi import (
    INC,
    Box,
    DiscountedCost,
    InputSector,
    L2Gain,
    Lifted,
    Margins,
    Plant,
    Polytopic,
    ReLU,
    Robust,
    Saturation,
    Stability,
    Together,
    certify,
    close_loop,
)
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.errors import InvalidInputError
from inc_casadi.inequalities import Inequalities
from inc_casadi.multipliers import Sector

PLANT = Plant([[0.5]], [[1.0]])
LAW = INC([[0.0]], [[2.0]], [[-0.3]], [[0.1]], activation=ReLU())
COST = DiscountedCost([[3.0]], [[4.0]], 0.5, Box([-1.0], [1.0]))


def test_each_claim_keeps_its_inequality_and_its_multiplier():
    claim = Together((Stability(0.9), COST, L2Gain([[1.0]]), L2Gain([[2.0]])))
    parts = Inequalities(close_loop(PLANT, LAW), claim, Sector())
    assert [unknown.name for unknown in parts.unknowns] == [
        "P", "gain^2 [3]", "gain^2 [4]", *(f"Lambda (decrease [{i}])" for i in (1, 2, 3, 4))]
    values = {"P": np.array([[2.0]]), "gain^2 [3]": np.array([5.0]), "gain^2 [4]": np.array([7.0])}
    values |= {f"Lambda (decrease [{i}])": np.array([0.1 * i]) for i in (1, 2, 3, 4)}
    found = parts.conditions(values)
    assert list(found) == ["P", "decrease [1]", "decrease [2]", "decrease [3]", "decrease [4]"]
    singles = ((Stability(0.9), {}), (COST, {}), (L2Gain([[1.0]]), {"gain^2": np.array([5.0])}),
               (L2Gain([[2.0]]), {"gain^2": np.array([7.0])}))
    for i, (single, own) in enumerate(singles, 1):
        alone = Inequalities(close_loop(PLANT, LAW), single, Sector())
        expected = alone.conditions({"P": values["P"], "Lambda": np.array([0.1 * i]), **own})["decrease"]
        np.testing.assert_array_equal(found[f"decrease [{i}]"], expected)


@pytest.mark.parametrize("multiplier", ["sector", "relu", "lifted"])
def test_every_part_is_true_with_the_one_V(multiplier):
    rng = np.random.default_rng(81)
    plant = draws.plant(rng, n=2, m=1, p=2, radius=0.7)
    inc = draws.controller(rng, m=1, p=2, norm=0.3, units=(ReLU(), ReLU(), Saturation()), gain=0.15)
    cost = DiscountedCost(np.diag([1.0, 0.4]), [[0.3]], 0.97, Box([-1, -1], [1, 1]))
    claim = Together((Stability(0.95), cost, L2Gain(np.eye(2), gain=9.0), Robust(Stability(), InputSector(0.8, 1.2))))
    found = certify(plant, inc, claim, multiplier=multiplier).require()
    assert found.prove() and found.bound >= certify(plant, inc, cost, multiplier=multiplier).bound * (1 - 1e-6)
    x0 = draws.points(rng, 2, 200)
    x, u = oracles.roll_out(plant, inc, x0, 60)

    def V(x):
        eta = np.stack([oracles.hidden(inc, plant.C @ x[..., k]) for k in range(x.shape[-1])], axis=-1)
        return oracles.quadratic(found.values["P"], x if multiplier != "lifted" else np.concatenate([x, eta]))

    along = V(x)
    assert np.all(along[:, 1:] <= 0.95**2 * along[:, :-1] * (1 + 1e-9) + 1e-300)
    assert np.all(oracles.discounted_cost(x, u, cost.Q, cost.R, 0.97) <= along[:, 0] * (1 + 1e-9))
    w = rng.normal(size=(2, 200, 60))
    x, _ = uncertain.disturbed(plant, inc, x0, w, np.eye(2))
    assert np.all(np.sum(x[..., :-1]**2, axis=(0, 2)) <= (along[:, 0] + 81 * np.sum(w**2, axis=(0, 2))) * (1 + 1e-9))
    gains = rng.choice([0.8, 1.2], size=(60, 200))
    x, _ = uncertain.varying(inc, x0, 60, lambda k: plant, lambda k, u: gains[k] * u)
    along = V(x)
    assert np.all(along[:, 1:] <= along[:, :-1] * (1 + 1e-9) + 1e-300)


def test_one_part_that_fails_fails_them_all():
    good = certify(PLANT, LAW, Together((Stability(0.9), COST))).require()
    for claims in ((Stability(0.4), COST), (Stability(0.9), DiscountedCost([[30.0]], [[4.0]], 0.5, Box([-1.0], [1.0])))):
        other = MatrixCertificate(PLANT, LAW, Together(claims), good.multiplier, good.values)
        assert not other.holds() and not other.prove("exact")
        assert not certify(PLANT, LAW, Together((Stability(0.4), COST))).holds()


def test_the_first_that_minimizes_leads():
    loop = close_loop(PLANT, LAW)
    values = {"P": np.array([[2.0]]), "gain^2 [2]": np.array([9.0])}
    gain_first = Together((Stability(0.9), L2Gain([[1.0]]), COST))
    cost_first = Together((Stability(0.9), COST, L2Gain([[1.0]])))
    assert gain_first.bound(loop, values) == pytest.approx(3.0) and gain_first.merit(loop, values) == pytest.approx(-3.0)
    assert cost_first.bound(loop, values) == pytest.approx(2 / 3)
    none = Together((Stability(0.9), Stability(0.8)))
    assert none.yes_or_no and none.bound(loop, values) == 0.9 and none.objective(none.graphs(loop, Sector()), values) is None
    sentence = gain_first.sentence(loop, values)
    assert all(f"({i})" in sentence for i in (1, 2, 3)) and "0.9^2" in sentence and "at most 3" in sentence


def test_what_it_refuses():
    for claims in ((Stability(), COST), (COST, Margins()), (COST, Polytopic(Stability(), (PLANT,))),
                   (COST, Together((Stability(0.9), COST)))):
        with pytest.raises(InvalidInputError, match="cannot share P here: give every claim its rate or level"):
            Together(claims)
    for claims in ((COST,), (), (COST, "stable")):
        with pytest.raises(InvalidInputError, match="at least two Claims"):
            Together(claims)
    with pytest.raises(InvalidInputError, match="rate = 1.5 is outside"):
        Together((Stability(1.5), COST)).check(PLANT, LAW)
    noisy = Together((Stability(0.9), L2Gain([[1.0]], D=[[1.0]])))
    assert "measurement is disturbed" in noisy.refusal(close_loop(PLANT, LAW), Lifted())
    moved = INC([[0.0]], [[2.0]], [[-0.3]], [[0.1]], b=[1.0])
    found = certify(PLANT, moved, Together((Stability(0.9), COST)), multiplier="sector")
    assert not found.holds() and "equilibrium x*" in found.reason
