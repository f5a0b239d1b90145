"""Which form of the NLP a training takes: the one asked for, the one an option belongs to, else by size."""

import numpy as np
import pytest
from training_problems import small, true_cost

from inc_casadi import Box, Plant
from inc_casadi.errors import InvalidInputError
from inc_casadi.linear.regulator import discounted_lqr
from synthesis.phases import Form
from synthesis.starts.random_start import linear_start, random_start
from synthesis.training import train
from synthesis.training_options import form_of, settled
from synthesis.training_setup import setup

PLAIN = {"form": "auto", "method": "adjoint", "hessian": "auto", "steps": "spectral", "readout": True, "states": None}
PLANT = Plant([[1.0, 0.2], [0.0, 1.0]], [[0.02], [0.2]])


@pytest.mark.parametrize("options, name", [
    ({}, "auto"), ({"form": "projected"}, "projected"), ({"steps": "adam"}, "projected"), ({"readout": False}, "lifted"),
    ({"method": "graph"}, "shooting"), ({"hessian": "limited-memory"}, "shooting"),
    ({"states": Box([-1, -1], [1, 1])}, "lifted"), ({"states": Box([-1, -1], [1, 1]), "readout": False}, "lifted")])
def test_an_option_of_one_form_names_it(options, name):
    assert form_of(PLANT, **PLAIN | options).name == name


def test_options_of_two_forms_contradict_each_other():
    with pytest.raises(InvalidInputError, match="readout belongs to the form 'lifted', but the form is 'projected'"):
        form_of(PLANT, **PLAIN | {"steps": "adam", "readout": False})
    with pytest.raises(InvalidInputError, match="states belongs to the form 'lifted', but the form is 'shooting'"):
        form_of(PLANT, **PLAIN | {"form": "shooting", "states": Box([-1, -1], [1, 1])})


def posed(hidden, frozen=()):
    plant, spec = small()
    start = random_start(plant, spec, hidden)
    return setup(plant, spec, start, kappa=0.9, horizon=None, order=None, anchored=True, frozen=frozen, terminal=None,
                 seed=0)


def test_few_units_are_trained_with_newton_steps_and_many_by_gradients():
    names = [settled(Form(), posed(hidden)).name for hidden in (0, 4, 12, 32, 64)]
    assert names == ["shooting"] * 3 + ["projected"] * 2
    assert settled(Form("shooting"), posed(64)).name == "shooting"


def test_no_dense_hessian_of_too_many_variables_is_formed_however_short_the_horizon_is():
    for hidden, size in ((4, 60), (32, 2000)):
        problem = posed(hidden)
        assert (problem.layout.size > 1000) == (size > 1000)
        assert (problem.sketch(problem.scenario(130, steps=2)) is None) == (size > 1000)


def test_the_form_taken_is_told():
    plant, spec = small()
    quick = {"horizon": 6, "order": 3, "max_iterations": 2}
    told = [train(plant, spec, random_start(plant, spec, hidden), **quick).form for hidden in (2, 40)]
    assert told == ["shooting", "projected"]


@pytest.mark.parametrize("steps", ["spectral", pytest.param("adam", marks=pytest.mark.slow)])
def test_sixty_four_units_are_trained_by_projected_gradients(steps):
    plant, spec = small()
    K, _ = discounted_lqr(plant, spec)
    options = {"horizon": 8, "order": 3}
    few = train(plant, spec, linear_start(0.2 * K, plant, spec, 3, seed=1), max_iterations=20, **options)
    start = linear_start(0.2 * K, plant, spec, 64, seed=1)
    result = train(plant, spec, start, form="projected", steps=steps, max_iterations=12, **options)
    cost, _, u = true_cost(plant, spec, result.inc)
    assert result.cost <= 1.01 * few.cost < 0.9 * result.start_cost and cost == pytest.approx(result.cost, rel=1e-2)
    assert result.inner.well_posedness().norm <= 0.95 and np.max(u) <= 0.5 and np.min(u) >= -1.0
