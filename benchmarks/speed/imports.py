"""How long `import inc_casadi` takes, which must load NumPy and nothing heavier."""

from __future__ import annotations

from .measurement import Measurement, in_fresh_process

TARGET = 1.0
HEAVY = ("casadi", "cvxpy", "control", "matplotlib", "scipy")
_CODE = """
import json, sys, time
start = time.perf_counter()
import inc_casadi
print(json.dumps([time.perf_counter() - start, [name for name in {heavy!r} if name in sys.modules]]))
"""


def imports(times: int = 5) -> list[Measurement]:
    """Return the least time of several fresh processes, for the others measure the disk."""
    runs = [in_fresh_process(_CODE.format(heavy=HEAVY)) for _ in range(times)]
    loaded = ", ".join(runs[0][1]) or "none of " + ", ".join(HEAVY)
    return [Measurement("import inc_casadi", min(seconds for seconds, _ in runs), "s", TARGET,
                        f"best of {times} fresh processes; loads {loaded}")]
