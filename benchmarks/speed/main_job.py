"""The whole main job: from the two-state plant and its specification to a certified controller with its bounds."""

from __future__ import annotations

from .measurement import Measurement, in_fresh_process

TARGET = 20.0
_CODE = """
import json, time
start = time.perf_counter()
from benchmarks.plants import two_state
from synthesis import synthesize
loaded = time.perf_counter()
case = two_state()
result = synthesize(case.plant, case.spec, hidden={hidden}, verbose=False)
print(json.dumps([time.perf_counter() - start, loaded - start, result.status, result.cost, dict(result.seconds)]))
"""


def main_job(hidden: int = 8) -> list[Measurement]:
    """Return the wall time of `synthesize` on the two-state plant in a fresh process, imports included, and its parts.

    hidden: hidden units that are trained, 0 for none.
    """
    whole, imports, status, cost, seconds = in_fresh_process(_CODE.format(hidden=hidden))
    parts = [Measurement(f"  of it {name}", value, "s") for name, value in seconds.items() if name != "in all"]
    first = Measurement("main job, two states", whole, "s", TARGET, f"fresh process, {status}, cost {cost:.7f}")
    return [first, Measurement("  of it imports", imports, "s"), *parts]
