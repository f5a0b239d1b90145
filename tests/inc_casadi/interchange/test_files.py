"""Files: everything comes back bit for bit, and what was altered is refused."""

import json
from dataclasses import fields

import numpy as np
import pytest

from inc_casadi import (
    INC,
    Box,
    CenteredLogistic,
    Ellipsoid,
    Empirical,
    Gaussian,
    Identity,
    LeakyReLU,
    Logistic,
    Plant,
    Polytope,
    ReLU,
    Saturation,
    Spec,
    Tanh,
    Uniform,
    load,
    save,
)
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.claims import DiscountedCost, Regional, Stability
from inc_casadi.errors import FormatError
from inc_casadi.interchange.files import KINDS

THIRD = 1 / 3
PLANT = Plant([[1.2, THIRD], [0.0, 1e-300]], [[THIRD], [1.0]], [[1.0, 0.1]], 0.1)
BOX = Box([-1.0, -THIRD], [1.0, 2.0])
MIXED = INC(np.diag([0.1, 0.2, 0.3]), np.ones((3, 1)), [[1.0, 2.0, THIRD]], [[0.5]], b=[0.0, 0.1, 0.2], d=[THIRD],
            activation=(LeakyReLU(THIRD), Tanh(), Identity()))
LAW = INC([[0.3, 0.2], [0.2, 0.3]], [[1.0], [-1.0]], [[-0.7, 0.7]], [[0.0]], activation=LeakyReLU(0.5))
COST = DiscountedCost([[1.0]], [[0.05]], 0.98, Box([-1.0], [1.0]))
PAPER = MatrixCertificate(Plant([[1.2]], [[1.0]]), LAW, COST, "sector", {"P": [[1.3006]], "Lambda": [0.7749, 0.7749]},
                          "typed from the paper")

NOUNS = [
    PLANT, MIXED, INC.linear([[THIRD]]), LAW, BOX, Uniform(BOX), Ellipsoid([[2.0, 0.1], [0.1, THIRD]], [1.0, 2.0], 0.7),
    Polytope([[1.0, 0.0], [-1.0, 0.5], [0.0, -1.0]], [1.0, THIRD, 2.0]), Gaussian([THIRD, 1.0], np.eye(2)),
    Empirical([[1.0, THIRD]]), Spec(np.eye(2), [[0.1]], 0.9, BOX, Box([-1.0], [1.0])), Spec(np.eye(2), [[0.1]], 0.9, BOX),
    Stability(), Stability(THIRD), COST, Regional(BOX, Box([-1.0], [1.0]), np.eye(2), [[0.1]], 0.9), PAPER, ReLU(), Tanh(),
    LeakyReLU(THIRD), Saturation(), Logistic(), CenteredLogistic(), Identity(),
]


def same(left, right):
    assert type(left) is type(right)
    if type(left) in KINDS:
        return all(same(getattr(left, f.name), getattr(right, f.name)) for f in fields(left) if f.init)
    if isinstance(left, np.ndarray):
        return left.shape == right.shape and left.tobytes() == right.tobytes()
    if isinstance(left, tuple):
        return len(left) == len(right) and all(same(a, b) for a, b in zip(left, right, strict=True))
    if hasattr(left, "items"):
        return sorted(left) == sorted(right) and all(same(left[name], right[name]) for name in left)
    return left == right


@pytest.mark.parametrize("noun", NOUNS, ids=lambda noun: type(noun).__name__)
def test_round_trip(noun, tmp_path):
    save(noun, tmp_path / "noun.json")
    assert same(noun, load(tmp_path / "noun.json"))


def test_a_loaded_certificate_proves_what_the_saved_one_did(tmp_path):
    PAPER.save(tmp_path / "paper.json")
    again = load(str(tmp_path / "paper.json"))
    assert again.margins() == PAPER.margins() and again.prove() and again.note == "typed from the paper"
    assert not again.values["P"].flags.writeable


def altered(tmp_path, change):
    path = tmp_path / "paper.json"
    PAPER.save(path)
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    return path


def pop(keys):
    def change(content):
        for key in keys[:-1]:
            content = content[key]
        content.pop(keys[-1])
    return change


def put(keys, value):
    def change(content):
        for key in keys[:-1]:
            content = content[key]
        content[keys[-1]] = value
    return change


@pytest.mark.parametrize(("change", "message"), [
    (pop(["format"]), "format"), (put(["format"], "onnx"), "format"), (put(["version"], 2), "version 2"),
    (put(["version"], True), "version True"), (pop(["version"]), "version None"),
    (put(["kind"], "Secret"), "'Secret', which this version does not know"), (pop(["data", "note"]), r"lacks \['note'\]"),
    (put(["data", "holds"], True), r"has \['holds'\]"), (put(["extra"], 1), "which no value has"),
    (put(["data", "plant", "data", "dt"], -1.0), "refuses its data"),
    (put(["data", "plant", "data", "A", "shape"], [2, 1]), "do not fill its shape"),
    (put(["data", "plant", "data", "A", "array"], ["1.2"]), "not numbers"),
    (put(["data", "plant", "data", "A", "array"], [True]), "not numbers"),
    (put(["data", "plant"], "a plant"), "refuses its data"), (put(["data", "plant"], {"A": 1}), "which no value has"),
    (put(["data", "values", "map", "P", "array"], [float("nan")]), "not a finite number"),
    (pop(["data", "values", "map", "Lambda"]), "refuses its data"),
    (put(["data", "inc", "data", "activation", "data", "slope"], 2.0), "refuses its data"),
    (put(["data", "multiplier"], "circle"), "refuses its data"),
])
def test_altered_files_are_refused(change, message, tmp_path):
    with pytest.raises(FormatError, match=message):
        load(altered(tmp_path, change))


def test_a_changed_number_is_read_but_proves_nothing(tmp_path):
    weaker = load(altered(tmp_path, put(["data", "values", "map", "P", "array"], [1.3])))
    assert not weaker.holds() and not weaker.prove()


def test_what_is_no_file_of_ours(tmp_path):
    for text in ("", "[1, 2]", "{", '"inc_casadi"', "\x00\xff"):
        (tmp_path / "x.json").write_text(text)
        with pytest.raises(FormatError):
            load(tmp_path / "x.json")
    (tmp_path / "bytes.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FormatError):
        load(tmp_path / "bytes.json")
    with pytest.raises(OSError):
        load(tmp_path / "absent.json")


def test_a_mapping_of_nouns(tmp_path):
    save({"plant": PLANT, "law": LAW, "seconds": 1.5}, tmp_path / "several.json")
    again = load(tmp_path / "several.json")
    assert same(again["plant"], PLANT) and same(again["law"], LAW) and again["seconds"] == 1.5


def test_what_cannot_be_saved(tmp_path):
    for thing in (3, {"A": object()}, {"A": np.inf}, np.eye(2), object()):
        with pytest.raises(FormatError, match="cannot be saved"):
            save(thing, tmp_path / "x.json")
    assert not (tmp_path / "x.json").exists()
