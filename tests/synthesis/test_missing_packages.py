"""A solver that is not installed is a note in the result, never a traceback; what needs no solver still works."""

import json
import subprocess
import sys

import pytest

SCRIPT = """
import json, sys
for name in sys.argv[1:]:
    sys.modules[name] = None
import numpy as np
from inc_casadi import Box, Plant, Spec
from synthesis import synthesize
spec = Spec(np.eye(2), [[0.05]], 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box([-1], [1]))
result = synthesize(Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]]), spec, hidden=2, tol=0.0, verbose=False)
print(json.dumps([result.status, result.cost, [one.note for one in result.history] + list(result.notes)]))
"""


@pytest.mark.parametrize(("missing", "words"), [
    pytest.param(["casadi"], "needs CasADi: pip install casadi", marks=pytest.mark.slow),
    pytest.param(["clarabel"], "pip install clarabel", marks=pytest.mark.slow),
    (["cvxpy", "casadi", "clarabel", "control", "matplotlib"], "pip install casadi"),
])
def test_the_saturated_lqr_is_proved_without(missing, words):
    run = subprocess.run([sys.executable, "-c", SCRIPT, *missing], capture_output=True, text=True, check=True)
    status, cost, notes = json.loads(run.stdout)
    assert status == "certified" and cost == pytest.approx(1.36496190, abs=1e-8)
    assert any(words in note for note in notes)
