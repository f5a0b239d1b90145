"""Where and when figures were measured: versions, commit, machine size, date."""

from __future__ import annotations

import os
import platform
import subprocess
from datetime import UTC, datetime
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version

from benchmarks.speed.measurement import ROOT

from .record import Environment

PACKAGES = {"inc_casadi": "inc-casadi", "numpy": "numpy", "scipy": "scipy", "casadi": "casadi", "cvxpy": "cvxpy",
            "clarabel": "clarabel", "control": "control"}

MEASURING = ("inc_casadi", "synthesis", "benchmarks/baselines", "benchmarks/contest")


def environment() -> Environment:
    """Return what is at work here and now.

    >>> found = environment()
    >>> "numpy" in found.versions, found.cores >= 1, found.same_code(found)
    (True, True, True)
    """
    versions = {"python": platform.python_version()} | {name: _version(package) for name, package in PACKAGES.items()}
    return Environment(versions, _source(), _commit(), cores(), _memory(), f"{platform.system()} {platform.machine()}",
                       datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"))


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _source() -> str:
    """A digest of all modules that a measurement may use; tables and pages of a changed command do not count."""
    found = sha256()
    for path in sorted(path for folder in MEASURING for path in (ROOT / folder).rglob("*.py")):
        found.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return found.hexdigest()[:16]


def _commit() -> str:
    """The commit, and whether files differ from it; "" outside a repository or without git."""
    commit = _git("rev-parse", "--short=12", "HEAD").strip()
    return f"{commit} with changes" if commit and _git("status", "--porcelain").strip() else commit


def _git(*arguments: str) -> str:
    try:
        run = subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, timeout=30)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return run.stdout.decode("utf-8", "replace") if run.returncode == 0 else ""


def cores() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _memory() -> float | None:
    """Memory in GiB, None where the system does not say."""
    names = getattr(os, "sysconf_names", {})
    if "SC_PHYS_PAGES" not in names or "SC_PAGE_SIZE" not in names:
        return None
    return round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30, 1)
