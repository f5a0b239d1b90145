"""The paper's figures, bounds on a suite of plants, and speed: `python -m benchmarks paper`, `bounds`, `speed`, `main`."""
