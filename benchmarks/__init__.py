"""The suite of plants, the paper's figures, bounds, and speed: `python -m benchmarks`, and `--help` for its commands."""
