"""Certificates are judged from their numbers alone: corrupt any of them and both judges say no."""

import subprocess
import sys
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

from inc_casadi import INC, Box, LeakyReLU, Plant, ReLU, Tanh
from inc_casadi.certificate import MatrixCertificate, Proof
from inc_casadi.claims import DiscountedCost, Stability
from inc_casadi.errors import DimensionError, InvalidInputError, NotCertifiedError

PLANT = Plant([[1.2]], [[1.0]])
INC_W = INC([[0.3, 0.2], [0.2, 0.3]], [[1.0], [-1.0]], [[-0.7, 0.7]], [[0.0]], activation=LeakyReLU(0.5))
CLAIM = DiscountedCost([[1.0]], [[0.05]], 0.98, Box([-1.0], [1.0]))
PAPER = MatrixCertificate(PLANT, INC_W, CLAIM, "sector", {"P": [[1.3006]], "Lambda": [0.7749, 0.7749]})


def refused(certificate):
    proof = certificate.prove()
    assert isinstance(proof, Proof) and not proof and proof.reason
    assert not certificate.holds() and certificate.reason
    assert certificate.sentence.startswith("Not certified: ")
    with pytest.raises(NotCertifiedError):
        certificate.require()
    return True


def test_the_paper_certificate_stands():
    assert PAPER.holds() and PAPER.require() is PAPER and PAPER.reason == ""
    proof = PAPER.prove()
    assert proof and proof.reason == "" and proof.seconds < 0.5 and "exact" in proof.method
    assert "at most 0.4335" in str(PAPER)


def scaled(name, factor):
    return {**PAPER.values, name: factor * PAPER.values[name]}


@pytest.mark.parametrize("corrupt", [
    {"values": scaled("P", 0.9999)}, {"values": scaled("P", -1.0)}, {"values": scaled("P", 0.0)},
    {"values": scaled("Lambda", 0.99)}, {"values": scaled("Lambda", 0.0)}, {"values": scaled("Lambda", -1.0)},
    {"plant": Plant([[1.21]], [[1.0]])}, {"plant": Plant([[1.2]], [[0.99]])}, {"plant": Plant([[1.2]], [[1.0]], [[1.01]])},
    {"inc": replace(INC_W, V=np.array([[-0.6, 0.7]]))}, {"inc": replace(INC_W, U=np.array([[1.0], [-0.9]]))},
    {"inc": replace(INC_W, K=np.array([[0.01]]))}, {"inc": replace(INC_W, W=np.zeros((2, 2)))},
    {"inc": replace(INC_W, W=np.array([[0.3, 0.2], [4.0, 0.3]]))},
    {"inc": replace(INC_W, activation=LeakyReLU(0.49))}, {"inc": replace(INC_W, activation=Tanh())},
    {"inc": replace(INC_W, d=np.array([0.1]))},
    {"claim": replace(CLAIM, Q=np.array([[1.001]]))}, {"claim": replace(CLAIM, R=np.array([[0.051]]))},
    {"claim": replace(CLAIM, discount=0.985)}, {"claim": Stability(0.2)},
])
def test_every_corruption_is_refused(corrupt):
    assert refused(replace(PAPER, **corrupt))


def test_values_must_be_those_that_are_asked_for():
    with pytest.raises(InvalidInputError, match="values holds P, but claim and multiplier sector ask for P, Lambda"):
        replace(PAPER, values={"P": [[1.0]]})
    with pytest.raises(InvalidInputError, match="multiplier relu ask for"):
        replace(PAPER, multiplier="relu")
    with pytest.raises(DimensionError, match="Lambda"):
        replace(PAPER, values={"P": [[1.0]], "Lambda": [1.0, 2.0, 3.0]})
    with pytest.raises(InvalidInputError, match="NaN"):
        replace(PAPER, values={"P": [[np.nan]], "Lambda": [1.0, 2.0]})
    with pytest.raises(InvalidInputError, match="must be a Claim"):
        replace(PAPER, claim="stable")
    with pytest.raises(InvalidInputError, match="needs a discrete plant"):
        replace(PAPER, plant=Plant([[1.2]], [[1.0]], dt=0))


def test_nothing_can_be_changed_afterwards():
    with pytest.raises(FrozenInstanceError):
        PAPER.note = "better"
    with pytest.raises(ValueError, match="read-only"):
        PAPER.values["P"][0, 0] = 1.0
    with pytest.raises(TypeError):
        PAPER.values["P"] = np.eye(1)


def test_a_sign_that_only_the_proof_of_soundness_needs_is_checked():
    # Negative weights on a unit that nothing depends on satisfy every matrix inequality but one sign.
    idle = INC(np.zeros((2, 2)), [[1.0], [0.0]], [[0.0, 0.0]], [[0.0]], activation=ReLU())
    good = MatrixCertificate(Plant([[0.5]], [[1.0]]), idle, Stability(0.6), "sector",
                             {"P": [[10.0]], "Lambda": [0.1, 1.0]})
    assert good.holds() and good.prove()
    values = {"N_sigma": np.zeros((2, 2)), "N_nu": np.zeros((2, 2)), "N_cross": [[-1.0, -1e-9], [0.0, -1.0]], "P": [[9.0]]}
    relu = MatrixCertificate(Plant([[0.5]], [[1.0]]), idle, Stability(0.6), "relu", values)
    assert relu.margins()["decrease"] > 0 and relu.margins()["N_cross >= 0"] == -1e-9
    assert refused(relu)
    assert replace(relu, values={**values, "N_cross": -np.eye(2)}).prove()


def test_a_decrease_without_a_positive_function_proves_nothing():
    # x+ = 2 x: P = -1 makes rho^2 P - 4 P positive, and only the condition on P itself objects.
    unstable = MatrixCertificate(Plant([[2.0]], [[1.0]]), INC.linear([[0.0]]), Stability(0.5), "sector",
                                 {"P": [[-1.0]], "Lambda": []})
    assert unstable.margins()["decrease"] > 0 and unstable.margins()["P"] < 0
    assert refused(unstable)


def test_what_holds_to_rounding_only_is_not_proved():
    # u = 2^-50 at x = 0: no difference to a discounted cost in floats, but not the origin that the theorem speaks of.
    law = INC(np.zeros((2, 2)), [[1.5], [1.5]], [[-1.0, 1.0]], [[0.0]], b=[1.0, -1.0], d=[1.0 + 2.0**-50])
    certificate = MatrixCertificate(Plant([[0.1]], [[0.1]]), law, CLAIM, "sector", {"P": [[3.0]], "Lambda": [0.5, 0.5]})
    assert certificate.holds(), certificate.reason
    assert not certificate.prove() and "at x = 0" in certificate.prove().reason


def test_exactly_zero_is_not_positive_and_a_hair_above_is():
    plant, law = Plant([[0.1]], [[1.0]]), INC.linear([[0.0]])
    certificate = MatrixCertificate(plant, law, Stability(0.1), "sector", {"P": [[1.0]], "Lambda": []})
    assert refused(certificate)
    hair = replace(certificate, claim=Stability(float(np.nextafter(0.1, 1.0))))
    assert hair.prove() and hair.holds() and 0 < hair.margins()["decrease"] < 1e-12
    below = replace(certificate, claim=Stability(float(np.nextafter(0.1, 0.0))))
    assert refused(below)
    assert replace(certificate, claim=Stability(0.1 + 1e-12)).holds()


def test_rounding_cannot_certify_what_is_false():
    # rho^2 P - A'PA of a rotation scaled by rho is zero up to the rounding of A: a plain eigenvalue has a random sign.
    rng = np.random.default_rng(51)
    fooled, true = 0, 0
    for _ in range(60):
        plant = Plant(0.7 * np.linalg.qr(rng.normal(size=(3, 3)))[0], np.ones((3, 2)))
        P = np.eye(3) * 10.0 ** rng.uniform(-8, 8)
        certificate = MatrixCertificate(plant, INC.linear(np.zeros((2, 3))), Stability(0.7), "sector",
                                        {"P": P, "Lambda": []})
        naive = np.linalg.eigvalsh(0.7**2 * P - plant.A.T @ P @ plant.A)[0] > 0
        proved = bool(certificate.prove())
        assert certificate.holds() == proved
        fooled, true = fooled + (naive and not proved), true + proved
    assert fooled > 0 and true > 0


@pytest.mark.parametrize("factor", [1e-9, 1e9])
def test_margins_do_not_depend_on_the_units_of_the_cost(factor):
    scaled_up = replace(PAPER, claim=replace(CLAIM, Q=factor * CLAIM.Q, R=factor * CLAIM.R),
                        values={name: factor * value for name, value in PAPER.values.items()})
    assert scaled_up.holds() and scaled_up.prove()
    for name in ("well-posed", "P", "decrease"):
        assert scaled_up.margins()[name] == pytest.approx(PAPER.margins()[name], rel=1e-6)


def test_margins_say_how_far():
    margins = PAPER.margins()
    assert margins["well-posed"] == pytest.approx(0.5)
    assert margins["Lambda >= 0"] == 0.7749
    assert margins["P"] == pytest.approx(1.0)
    # The paper's 2.23e-5 is absolute; ours is in terms of what cancels, so of the same order but smaller.
    assert 1e-7 < margins["decrease"] < 2.23e-5


def test_the_reason_names_the_assumption():
    ill = replace(PAPER, inc=replace(INC_W, W=np.array([[0.3, 0.2], [4.0, 0.3]])))
    assert "lambda_pf(S|W|)" in ill.reason and "thm:wellposed" in ill.prove().reason
    assert ill.margins()["well-posed"] < 0
    shifted = replace(PAPER, inc=replace(INC_W, d=np.array([0.1])))
    assert "equilibrium x*" in shifted.reason and "equilibrium x*" in shifted.prove().reason
    negative = replace(PAPER, values=scaled("Lambda", -1.0))
    assert "Lambda has a negative entry" in negative.prove().reason
    weak = replace(PAPER, values=scaled("P", 0.99))
    assert "sector multiplier, the condition 'decrease' has the relative margin -" in weak.reason


def test_checking_needs_numpy_alone():
    code = ("import sys, inc_casadi, inc_casadi.certificate, inc_casadi.interchange, inc_casadi.certify\n"
            "heavy = {'cvxpy', 'casadi', 'scipy', 'control', 'matplotlib', 'clarabel'} & set(sys.modules)\n"
            "assert not heavy, heavy")
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
