"""Whatever a public function or a public noun gives back can be named without the name of a module inside a package."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pickle
import typing
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("matplotlib", reason="the types of pictures are among them: pip install matplotlib")

PACKAGES = [
    "inc_casadi", "inc_casadi.activations", "inc_casadi.affine_pieces", "inc_casadi.bounds", "inc_casadi.claims",
    "inc_casadi.comparison", "inc_casadi.dynamic", "inc_casadi.interchange", "inc_casadi.interchange.c_code",
    "inc_casadi.judgement", "inc_casadi.linear", "inc_casadi.multipliers", "inc_casadi.output_bounds", "inc_casadi.plotting",
    "inc_casadi.sets", "inc_casadi.types", "inc_casadi.uncertainty", "synthesis",
]
NAMED = {f"{package}.{name}": getattr(importlib.import_module(package), name)
         for package in PACKAGES for name in importlib.import_module(package).__all__}


def functions(noun: type) -> Iterator[tuple[str, Any]]:
    """The public methods and properties of a class as plain functions, by name."""
    for name, member in vars(noun).items():
        plain = getattr(member, "fget", None) or getattr(member, "func", None) or getattr(member, "__func__", member)
        if not name.startswith("_") and inspect.isfunction(plain):
            yield name, plain


def given_back(name: str, thing: Any) -> Iterator[tuple[str, Any]]:
    """The annotations of what a public function, or a public noun's methods and fields, give back."""
    whole = dict(functions(thing)) if inspect.isclass(thing) else {"": thing} if inspect.isfunction(thing) else {}
    for part, function in whole.items():
        yield f"{name}.{part}", hints(function).get("return")
    if dataclasses.is_dataclass(thing):
        found = hints(thing)
        for field in dataclasses.fields(thing):
            if not field.name.startswith("_"):
                yield f"{name}.{field.name}", found.get(field.name)


def hints(thing: Any) -> dict[str, Any]:
    """The annotations, none where a name is known to the type checker alone."""
    try:
        return typing.get_type_hints(thing)
    except NameError:
        return {}


def classes(annotation: Any) -> Iterator[type]:
    """The classes in an annotation."""
    if inspect.isclass(annotation):
        yield annotation
    for part in typing.get_args(annotation):
        yield from classes(part)


def test_every_type_that_is_given_back_can_be_imported_from_a_package():
    known = {id(thing) for thing in NAMED.values()}
    ours = ("inc_casadi", "synthesis")
    # What the types of results consist of inside is not followed further.
    lacking = {f"{kind.__module__}.{kind.__qualname__}, of {where}" for name, thing in NAMED.items()
               if not name.startswith("inc_casadi.types.")
               for where, annotation in given_back(name, thing) for kind in classes(annotation)
               if kind.__module__.partition(".")[0] in ours and id(kind) not in known}
    assert sorted(lacking) == []


def test_the_check_sees_what_it_is_to_see():
    seen = {where: list(classes(annotation)) for where, annotation in given_back("INC", NAMED["inc_casadi.INC"])}
    assert seen["INC.solve"] == [NAMED["inc_casadi.types.FixedPoint"]]
    assert seen["INC.contraction"] == [NAMED["inc_casadi.types.WellPosedness"]] and seen["INC.W"] != []
    assert len(NAMED) > 150


@pytest.mark.parametrize("package", PACKAGES)
def test_all_lists_names_in_order_and_once(package):
    names = importlib.import_module(package).__all__
    assert list(names) == sorted(set(names))


def test_nouns_can_be_sent_to_another_process():
    for name in ("inc_casadi.types.Equilibrium", "inc_casadi.CriticalRegions", "inc_casadi.Plant"):
        assert pickle.loads(pickle.dumps(NAMED[name])) is NAMED[name]
