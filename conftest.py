"""Import the package once before pytest collects its modules by path, so that no class exists twice."""

import inc_casadi  # noqa: F401
