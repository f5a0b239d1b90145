"""The program in numbers near 1 is the problem it came from."""

import numpy as np
from lmi_draws import feasible, matrices

from inc_casadi.cone_program import normalized


def test_the_normalized_program_is_the_problem():
    drawn = feasible(np.random.default_rng(1), spread=3.0, box=50.0)
    program, y = normalized(drawn), np.random.default_rng(5).normal(size=drawn.size)
    parts = program.slack(y / program.unknowns)
    for part, block in zip(parts[:-1], drawn.blocks, strict=True):
        ratio = part / block.value(y)
        assert np.all(ratio > 0) and np.ptp(ratio) < 1e-9 * np.max(ratio)
    linear = np.concatenate([drawn.rows @ y + drawn.offset, y - drawn.lower, drawn.upper - y])
    np.testing.assert_array_equal(parts[-1] > 0.0, linear > 0.0)
    ratio = program.cost / program.unknowns / drawn.cost
    assert np.ptp(ratio) < 1e-9 * np.max(ratio)
    explicit = [matrices(block, drawn.size) for block in drawn.blocks]
    assert max(np.max(np.linalg.norm(A, axis=(1, 2))) for A in explicit) > 1e2  # the draw is badly scaled
    for A in program.parts:
        assert 0.1 < max(np.linalg.norm(A.image(e)) for e in np.eye(drawn.size)) < 10.0
