"""The paper's figures recomputed, and how fast that goes: `python -m benchmarks paper`, `speed` or `main`."""
