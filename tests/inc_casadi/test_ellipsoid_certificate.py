"""The certificate of an ellipsoid: proofs, corrupted numbers, files, and the command that checks them."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from attraction_draws import TWO_STATES, lqr, mixed, unstable

from inc_casadi import INC, Box, Plant, Saturation, load
from inc_casadi.claims import Attraction, Stability
from inc_casadi.ellipsoid_certificate import EllipsoidCertificate
from inc_casadi.errors import INCError, InvalidInputError, NotCertifiedError
from inc_casadi.local.certify import certify_attraction
from inc_casadi.local.methods import method_of

LAW = INC.saturated(lqr(TWO_STATES, 0.98, 0.05), 1.0)
CLAIM = Attraction(Box([-0.9], [0.9]), Box([-4.0, -4.0], [4.0, 4.0]), np.eye(2), [[0.1]], 0.9, 0.98)
METHODS = ("linear", "convex hull", "dead zone", "polytope")


@pytest.fixture(scope="module", params=METHODS)
def found(request):
    return certify_attraction(TWO_STATES, LAW, CLAIM, request.param)


def test_it_holds_and_is_proved_by_either_means(found):
    assert found.holds() and not found.reason and found.require() is found and found.surely()
    assert found.prove("float").method.startswith("floating") and found.prove("exact").method.startswith("exact")
    assert found.prove("exact") and min(found.margins().values()) >= 0
    assert found.volume == found.ellipsoid.volume >= found.bound > 0


def test_the_sentence_says_all_that_is_claimed(found):
    text = found.sentence
    for part in ("x0'P x0 <= 1", "volume at least", "converges to x* = [0. 0.]", "0.98^2", "every input", "every state",
                 "discount 0.9", "x0'P_cost x0"):
        assert part in text


def test_every_corrupted_number_is_refused(found):
    for name, value in found.values.items():
        worse = {"P": 0.5 * value, "P_cost": 0.5 * value}.get(name, -value if np.any(value > 0) else 5.0 * value)
        for changed in (worse, np.zeros_like(value)):
            if name == "F" and not changed.any():
                continue  # a region without half-spaces is a sound one
            broken = replace(found, values={**found.values, name: changed})
            if np.array_equal(changed, value):
                continue
            assert not broken.holds() and broken.reason, name
            assert not broken.prove("exact") and not broken.prove("float") and not broken.surely(), name
            assert broken.bound == 0.0 and "Not certified" in broken.sentence
            with pytest.raises(NotCertifiedError):
                broken.require()


def test_it_speaks_of_its_own_loop_and_claim_only(found):
    stronger = [replace(found.claim, rate=0.5), replace(found.claim, inputs=Box([-0.01], [0.01])),
                replace(found.claim, states=Box([-0.01, -4.0], [4.0, 4.0])), replace(found.claim, Q=1000 * np.eye(2)),
                replace(found.claim, discount=1.0, R=[[1e4]])]
    for claim in stronger:
        assert not replace(found, claim=claim).holds() and not replace(found, claim=claim).prove("exact")
    assert not replace(found, plant=Plant(1.3 * TWO_STATES.A, TWO_STATES.B)).holds()
    assert not replace(found, inc=INC.saturated(0.2 * lqr(TWO_STATES), 1.0)).holds()


@pytest.mark.slow
def test_it_is_saved_and_checked_by_the_command(found, tmp_path):
    found.save(tmp_path / "c.json")
    again = load(tmp_path / "c.json")
    assert again.sentence == found.sentence and again.margins() == found.margins()
    for extra in ([], ["--exact"]):
        run = subprocess.run([sys.executable, "-m", "inc_casadi", "check", str(tmp_path / "c.json"), *extra],
                             capture_output=True, text=True, check=False)
        assert run.returncode == 0 and "Proved" in run.stdout, run.stderr


def test_checking_loads_numpy_alone(tmp_path):
    rng = np.random.default_rng(0)
    plant = unstable(rng, n=2)
    found = certify_attraction(plant, mixed(rng, plant), Attraction(), "dead zone")
    found.save(tmp_path / "c.json")
    code = (f"import sys; from inc_casadi.__main__ import main; status = main(['check', {str(tmp_path / 'c.json')!r}]); "
            "print(status, sorted({'cvxpy', 'scipy', 'clarabel'} & set(sys.modules)))")
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.endswith("0 []\n") and "(x0 - x*)" in run.stdout


def test_auto_takes_the_largest_and_tells_of_the_others():
    found = certify_attraction(TWO_STATES, LAW, Attraction())
    sizes = [certify_attraction(TWO_STATES, LAW, Attraction(), name).volume for name in METHODS]
    assert found.volume == pytest.approx(max(sizes), rel=1e-12)
    assert all(name in found.note for name in METHODS)


def test_directions_scale_what_they_name():
    corners = np.array([[1.0, 1.0], [1.0, -1.0]])
    reach = certify_attraction(TWO_STATES, LAW, Attraction(directions=corners), "convex hull")
    mean = certify_attraction(TWO_STATES, LAW, Attraction(directions=corners, shape="mean"), "convex hull")
    assert np.all(reach.ellipsoid.contains(reach.bound * corners))
    assert not np.all(reach.ellipsoid.contains(1.001 * reach.bound * corners))
    assert mean.bound >= reach.bound * (1 - 1e-6) and mean.claim.merit(reach.values["P"]) <= mean.bound * (1 + 1e-6)
    assert reach.bound > reach.claim.merit(mean.values["P"]) * (1 + 1e-3)
    volume = certify_attraction(TWO_STATES, LAW, Attraction(), "convex hull")
    assert volume.volume > reach.volume and volume.claim.merit(volume.values["P"]) > volume.claim.merit(reach.values["P"])


def test_without_numbers_it_says_why():
    lost = certify_attraction(TWO_STATES, INC.saturated(0.01 * lqr(TWO_STATES), 1.0), Attraction())
    assert not lost.holds() and "does not attract" in lost.reason and lost.volume == lost.bound == 0.0 and not lost.prove()
    with pytest.raises(InvalidInputError, match="no ellipsoid"):
        lost.ellipsoid  # noqa: B018
    nowhere = certify_attraction(Plant([[1.0]], [[1.0]]), INC([[0.0]], [[0.0]], [[1.0]], [[0.0]], d=[3.0]), Attraction())
    assert "equilibrium" in nowhere.reason
    loose = certify_attraction(TWO_STATES, INC([[2.0]], [[1.0, 0.0]], [[1.0]], [[0.0, 0.0]]), Attraction())
    assert "well posed" in loose.reason


def test_a_law_that_is_not_well_posed_is_refused_though_its_inequalities_hold():
    law = INC([[2.0]], [[0.1]], [[1.0]], [[0.0]], activation=Saturation())
    found = EllipsoidCertificate(Plant([[0.5]], [[1.0]]), law, Attraction(), "linear", {"P": [[10.0]], "T": [1.0]})
    margins = found.margins()
    assert min(value for name, value in margins.items() if name != "well-posed") > 0 >= margins["well-posed"]
    assert not found.holds() and "well posed" in found.reason
    assert not any(found.prove(method) for method in ("auto", "float", "exact"))


def test_what_is_no_certificate_is_refused_at_the_door():
    values = {"P": np.eye(2), "H": np.zeros((1, 2))}
    with pytest.raises(InvalidInputError, match="asks for P, H"):
        EllipsoidCertificate(TWO_STATES, LAW, Attraction(), "convex hull", {"P": np.eye(2)})
    with pytest.raises(InvalidInputError, match="'guess'"):
        EllipsoidCertificate(TWO_STATES, LAW, Attraction(), "guess", values)
    with pytest.raises(InvalidInputError, match="Attraction"):
        EllipsoidCertificate(TWO_STATES, LAW, Stability(), "convex hull", values)
    with pytest.raises(INCError):
        EllipsoidCertificate(TWO_STATES, LAW, Attraction(), "convex hull", {**values, "H": np.zeros((2, 2))})
    with pytest.raises(InvalidInputError, match="'maybe'"):
        EllipsoidCertificate(TWO_STATES, LAW, Attraction(), "convex hull", values).prove("maybe")
    with pytest.raises(InvalidInputError, match="must be one of"):
        method_of("")
    with pytest.raises(InvalidInputError, match="must be an Attraction"):
        certify_attraction(TWO_STATES, LAW, Stability())
    with pytest.raises(InvalidInputError, match="must be an INC"):
        certify_attraction(TWO_STATES, [[1.0]], Attraction())
