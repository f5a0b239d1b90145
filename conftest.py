"""Import the package once before pytest collects its modules by path, so that no class exists twice."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # tests run side by side, one for each core

import inc_casadi  # noqa: E402, F401
