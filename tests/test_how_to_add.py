"""The examples of the pages "how to add" run as they stand, and what they add is true on trajectories."""

import re
from pathlib import Path

import numpy as np
import oracles
import pytest

from inc_casadi import INC, LeakyReLU, Plant
from synthesis.registry import STARTS

PAGES = Path(__file__).parents[1] / "examples" / "site" / "how_to"


def run(page):
    """Execute the one example of a page, and return its names."""
    blocks = re.findall(r"```python\n(.*?)```", (PAGES / f"{page}.md").read_text(encoding="utf-8"), flags=re.DOTALL)
    assert len(blocks) == 1
    names = {"__name__": page}
    exec(compile(blocks[0], f"{page}.md", "exec"), names)
    return names


def test_every_page_is_tested_here_and_listed():
    pages = {path.stem for path in PAGES.glob("*.md")} - {"index"}
    assert pages == {"activation", "claim", "start", "plant", "baseline"}
    assert all(f"\n{page}\n" in (PAGES / "index.md").read_text(encoding="utf-8") for page in pages)


def test_an_activation(capsys):
    names = run("activation")
    unit, everywhere, exact = names["DeadZone"](), names["everywhere"], names["from_a_box"]
    z = np.linspace(-5, 5, 1001)
    value = z - np.clip(z, -1, 1)
    np.testing.assert_allclose(unit(z), value, atol=1e-15)
    chord = np.diff(value) / np.diff(z)
    assert chord.min() >= -1e-12 and chord.max() <= 1 + 1e-9 and np.allclose(unit(-z), -value, atol=1e-15)
    assert everywhere.holds() and exact.holds() and everywhere.prove() and exact.prove()
    x = np.linspace(-1, 1, 4001)
    u = -0.5 * x - 0.4 * (2 * x - np.clip(2 * x, -1, 1))
    paid, state = np.zeros_like(x), x
    for k in range(300):
        u = -0.5 * state - 0.4 * (2 * state - np.clip(2 * state, -1, 1))
        paid, state = paid + 0.95**k * (state**2 + 0.1 * u**2), 1.2 * state + u
    mean = np.trapezoid(paid, x) / 2 if hasattr(np, "trapezoid") else np.trapz(paid, x) / 2
    assert exact.expected == pytest.approx(mean, rel=1e-6) and exact.expected <= everywhere.bound
    assert capsys.readouterr().out.count("succeeded=True") == 2


def test_a_claim(capsys):
    names = run("claim")
    certificate, plant, inc = names["certificate"], names["plant"], names["inc"]
    assert certificate.holds() and certificate.prove() and "energy of the input" in capsys.readouterr().out
    x0 = np.random.default_rng(1).normal(size=(2, 400)) * np.geomspace(0.1, 20, 400)
    _, u = oracles.roll_out(plant, inc, x0, 400)
    spent = np.sum(u**2, axis=(0, 2))
    assert np.all(spent <= certificate.bound * np.sum(x0**2, axis=0) * (1 + 1e-9))
    # For a linear law the least bound is the largest eigenvalue of the Gramian of (A + B K, K).
    K = np.array([[-0.2, -0.6]])
    closed, gramian = plant.A + plant.B @ K, np.zeros((2, 2))
    for _ in range(2000):
        gramian = K.T @ K + closed.T @ gramian @ closed
    linear = names["certify"](plant, INC.linear(K), names["InputEnergy"]()).require()
    assert linear.bound == pytest.approx(np.linalg.eigvalsh(gramian)[-1], rel=1e-4)
    # A leaky unit, so that the multiplier with hidden vectors to come applies too.
    leaky = INC([[0.2]], [[0.3, 0.4]], [[-0.5]], [[0.0, 0.0]], activation=LeakyReLU(0.5))
    assert names["certify"](plant, leaky, names["InputEnergy"](), multiplier="lifted").require().prove()
    with pytest.raises(ValueError, match="discrete time only"):
        names["certify"](Plant(-1.0, 1.0, dt=0), INC.linear([[0.0]]), names["InputEnergy"]())


def test_a_start(capsys):
    names = run("start")
    plant, law, result = names["plant"], names["law"], names["result"]
    x = np.array([[0.3], [-0.7]])
    for _ in range(2):
        x = plant.A @ x + plant.B @ law.K @ x
    np.testing.assert_allclose(x, 0.0, atol=1e-12)
    assert result.status == "certified" and result.certificate.prove() and "certified" in capsys.readouterr().out
    assert "deadbeat" not in STARTS  # else the page may name another
    with pytest.raises(ValueError, match="one input"):
        names["deadbeat"](Plant(np.eye(2), np.eye(2)), names["spec"], 0, None, 0.9, 0)


def test_a_plant(capsys):
    names = run("plant")
    case, found = names["case"], names["found"]
    period = 2 * np.pi / np.sqrt(2.0 - 0.05**2)  # of the damped oscillation
    angle = np.abs(np.angle(np.linalg.eigvals(case.plant.A))).max()
    assert angle == pytest.approx(2 * np.pi * 0.2 / period, rel=1e-9)
    assert all(one.controller is not None for one in found.values()) and "at least" in capsys.readouterr().out


def test_a_baseline(capsys):
    names = run("baseline")
    laws, table = names["laws"], names["table"]
    assert set(laws) == {"minimum effort", "saturated LQR"}
    assert laws["minimum effort"]([0.1])[0] == pytest.approx(-(1.5 - 1 / 1.5) * 0.1, rel=1e-6)  # the mode 1.5 becomes 1/1.5
    assert np.isfinite(table.cost_of("minimum effort")) and table.cost_of("saturated LQR") < table.cost_of("minimum effort")
    assert "minimum effort" in capsys.readouterr().out
