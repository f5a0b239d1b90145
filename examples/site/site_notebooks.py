"""Bring the teaching notebooks into the site: copies in build/, which version control leaves out."""

from __future__ import annotations

import shutil
from typing import Any

import site_registry
from sphinx.application import Sphinx
from sphinx.config import Config

SOURCE, COPIES = site_registry.HERE.parent / "notebooks", site_registry.HERE / "build" / "notebooks"


def copy(app: Sphinx, config: Config) -> None:
    """Copy what has changed and drop what is gone."""
    COPIES.mkdir(parents=True, exist_ok=True)
    current = {path.name: path for path in SOURCE.glob("*.ipynb")}
    for stale in COPIES.iterdir():
        if stale.name not in current:
            stale.unlink()
    for name, path in current.items():
        if not (COPIES / name).exists() or (COPIES / name).read_bytes() != path.read_bytes():
            shutil.copyfile(path, COPIES / name)


def setup(app: Sphinx) -> dict[str, Any]:
    """Copy before the sources are listed."""
    app.connect("config-inited", copy)
    return {"parallel_read_safe": True}
