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
ILL = replace(INC_W, W=np.array([[0.3, 0.2], [4.0, 0.3]]))


def refused(certificate):
    for method in ("auto", "float", "exact"):
        proof = certificate.prove(method)
        assert isinstance(proof, Proof) and not proof and proof.reason
    assert not certificate.surely() and not certificate.surely(99)
    assert not certificate.holds() and certificate.reason
    assert certificate.sentence.startswith("Not certified: ")
    with pytest.raises(NotCertifiedError):
        certificate.require()
    return True


def test_the_paper_certificate_stands():
    assert PAPER.holds() and PAPER.require() is PAPER and PAPER.reason == ""
    proof = PAPER.prove()
    assert proof and proof.reason == "" and proof.seconds < 0.5
    assert proof.method == "floating point with every rounding bounded" and PAPER.prove("float").method == proof.method
    settled = PAPER.prove(method="exact")
    assert settled and settled.reason == "" and settled.method == "exact rational arithmetic"
    with pytest.raises(InvalidInputError, match="method is 'fast', but must be 'auto', 'float' or 'exact'"):
        PAPER.prove("fast")
    assert "at most 0.4335" in str(PAPER)


def scaled(name, factor):
    return {**PAPER.values, name: factor * PAPER.values[name]}


@pytest.mark.parametrize("corrupt", [
    {"values": scaled("P", 0.9999)}, {"values": scaled("P", -1.0)}, {"values": scaled("P", 0.0)},
    {"values": scaled("Lambda", 0.99)}, {"values": scaled("Lambda", 0.0)}, {"values": scaled("Lambda", -1.0)},
    {"plant": Plant([[1.21]], [[1.0]])}, {"plant": Plant([[1.2]], [[0.99]])}, {"plant": Plant([[1.2]], [[1.0]], [[1.01]])},
    {"inc": replace(INC_W, V=np.array([[-0.6, 0.7]]))}, {"inc": replace(INC_W, U=np.array([[1.0], [-0.9]]))},
    {"inc": replace(INC_W, K=np.array([[0.01]]))}, {"inc": replace(INC_W, W=np.zeros((2, 2)))},
    {"inc": ILL, "values": {**PAPER.values, "T": [1.0, 1.0]}}, {"inc": ILL, "values": {**PAPER.values, "T": [20.0, 1.0]}},
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
    with pytest.raises(DimensionError, match="R 2 x 2, but the plant has 1 states and 1 inputs"):
        replace(PAPER, claim=replace(PAPER.claim, R=np.eye(2)))


def test_a_product_that_the_multiplier_may_not_use_is_refused():
    # Links between a ReLU and a tanh, or of a unit with itself, are no products that soundness is shown for.
    law = INC(np.zeros((3, 3)), [[1.0], [0.5], [0.3]], [[0.1, 0.1, 0.1]], [[0.0]], activation=(ReLU(), ReLU(), Tanh()))
    links = np.zeros((3, 3))
    links[0, 1] = 0.1
    values = {"P": [[9.0]], "r": [1.0, 1.0, 1.0], "O": links}
    assert MatrixCertificate(Plant([[0.5]], [[1.0]]), law, Stability(0.9), "slope", values).holds()
    for i, j in ((0, 0), (0, 2), (2, 1)):
        forbidden = links.copy()
        forbidden[i, j] = 0.1
        with pytest.raises(InvalidInputError, match="O has an entry that must be zero"):
            MatrixCertificate(Plant([[0.5]], [[1.0]]), law, Stability(0.9), "slope", {**values, "O": forbidden})


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
    # h = (sigma_1, nu_1, sigma_2, nu_2): sigma_1 nu_2 is a product that may be positive, sigma_1 nu_1 is always zero.
    N = np.zeros((4, 4))
    N[[0, 1, 2, 3], [1, 0, 3, 2]] = -1.0
    low = N.copy()
    low[0, 3] = low[3, 0] = -1e-9
    relu = MatrixCertificate(Plant([[0.5]], [[1.0]]), idle, Stability(0.6), "relu", {"P": [[9.0]], "N": low})
    assert relu.margins()["decrease"] > 0 and relu.margins()["N >= 0"] == -1e-9
    assert refused(relu)
    assert replace(relu, values={"P": [[9.0]], "N": N}).prove()


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
    ill = replace(PAPER, inc=ILL, values={**PAPER.values, "T": [20.0, 1.0]})
    assert "Perron-Frobenius radius 1.19" in ill.reason and "thm:wellposed" in ill.prove().reason
    assert ill.margins()["well-posed"] < 0
    shifted = replace(PAPER, inc=replace(INC_W, d=np.array([0.1])))
    assert "equilibrium x*" in shifted.reason and "equilibrium x*" in shifted.prove().reason
    negative = replace(PAPER, values=scaled("Lambda", -1.0))
    assert "Lambda has a negative entry" in negative.prove().reason
    weak = replace(PAPER, values=scaled("P", 0.99))
    assert "sector multiplier, the condition 'decrease' has the relative margin -" in weak.reason


def test_a_law_that_only_the_multiplier_T_proves_well_posed():
    # eta = relu(-3 eta + 2 x): Picard's iteration diverges, 2T - TW - W'T = 8 T > 0.
    law, plant = INC([[-3.0]], [[2.0]], [[-0.3]], [[0.1]]), Plant([[0.5]], [[1.0]])
    good = MatrixCertificate(plant, law, Stability(0.8), "sector", {"P": [[1.0]], "Lambda": [0.2], "T": [1.0]})
    assert good.holds() and good.prove() and good.prove("exact") and good.margins()["well-posed"] > 0
    assert refused(replace(good, values={**good.values, "T": [0.0]}))
    assert refused(replace(good, values={**good.values, "T": [-1.0]}))
    with pytest.raises(InvalidInputError, match="values holds Lambda, P, but .* ask for P, Lambda, T"):
        replace(good, values={"P": [[1.0]], "Lambda": [0.2]})
    with pytest.raises(InvalidInputError, match="values holds Lambda, P, T, but"):
        replace(good, inc=replace(law, W=np.array([[0.3]])))


def test_checking_needs_numpy_alone():
    code = ("import sys, inc_casadi, inc_casadi.certificate, inc_casadi.interchange, inc_casadi.certify\n"
            "heavy = {'cvxpy', 'casadi', 'scipy', 'control', 'matplotlib', 'clarabel'} & set(sys.modules)\n"
            "assert not heavy, heavy")
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
