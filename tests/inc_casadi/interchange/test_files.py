"""Files: everything comes back bit for bit, what was altered is refused, and a forged digest proves nothing false."""

import copy
import json
import re
from dataclasses import fields

import numpy as np
import pytest

from inc_casadi import (
    INC,
    Box,
    CenteredLogistic,
    DeviationCost,
    Ellipsoid,
    Empirical,
    Gaussian,
    Identity,
    InputSector,
    L2Gain,
    LeakyReLU,
    Lifted,
    Logistic,
    Margins,
    NormBounded,
    Plant,
    Polytope,
    Polytopic,
    ReLU,
    Robust,
    Saturation,
    Spec,
    Tanh,
    Together,
    Uniform,
    certify,
    load,
    save,
)
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.claims import DiscountedCost, Regional, Stability
from inc_casadi.errors import FormatError
from inc_casadi.interchange.files import KINDS, digest
from inc_casadi.multipliers import Relu, Sector, Slope

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
    LeakyReLU(THIRD), Saturation(), Logistic(), CenteredLogistic(), Identity(), Sector(), Slope(), Relu(), Lifted(),
    Lifted(3), DeviationCost([[THIRD]], [[0.05]], 0.98, Gaussian([1.0], [[THIRD]])), L2Gain([[THIRD]]),
    L2Gain([[1.0]], [[THIRD]], [[0.2]], [[0.3]], [[0.4]], THIRD), Margins(), Margins(THIRD), InputSector(THIRD, 4 * THIRD),
    NormBounded([[THIRD]], [[1.0]]), NormBounded([[1.0]], [[THIRD]], [[0.5]], 0.7),
    Robust(L2Gain([[1.0]]), InputSector(THIRD, 2.0)),
    Polytopic(Robust(Stability(), InputSector.disk(THIRD)), (Plant([[THIRD]], [[1.0]]),)), Polytopic(COST, (PLANT, PLANT)),
    Together((Stability(0.9), COST, Robust(Stability(), NormBounded([[THIRD]], [[1.0]])))),
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


STABLE = Plant([[0.5]], [[1.0]])
GENTLE = INC([[0.3, 0.2], [0.2, 0.3]], [[0.3], [-0.3]], [[-0.2, 0.3]], [[0.0]], activation=LeakyReLU(0.5))
CLAIMS = [L2Gain([[1.0]]), Margins(0.3), Robust(COST, NormBounded([[0.1]], [[1.0]], [[1.0]])),
          Polytopic(Robust(Stability(), InputSector(0.8, 1.2)), (Plant([[0.4]], [[1.1]]), Plant([[0.45]], [[0.9]]))),
          Together((Stability(0.9), COST, L2Gain([[1.0]], gain=9.0))),
          DeviationCost([[1.0]], [[0.05]], 0.98, Box([-1.0], [1.0]))]


@pytest.mark.parametrize("multiplier", ["sector", "slope", "relu", "lifted", Lifted(2)])
@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: type(claim).__name__)
def test_certificates_of_every_claim_and_rung_come_back_and_prove(claim, multiplier, tmp_path):
    found = certify(STABLE, GENTLE, claim, multiplier=multiplier)
    if not found.holds():
        assert "was asked for, but" in found.note and multiplier in ("lifted", Lifted(2))
        return
    found.save(tmp_path / "certificate.json")
    again = load(tmp_path / "certificate.json")
    assert same(found, again) and again.prove() and again.prove("exact")
    assert again.sentence == found.sentence and again.bound == found.bound and again.margins() == found.margins()


def test_tuples_of_plants_and_claims_stay_tuples(tmp_path):
    claim = Together((Polytopic(COST, (STABLE, Plant([[0.4]], [[1.1]]))), Stability(0.9)))
    save(claim, tmp_path / "claim.json")
    again = load(tmp_path / "claim.json")
    assert type(again.claims) is tuple and type(again.claims[0].plants) is tuple and len(again.claims[0].plants) == 2
    single = Polytopic(COST, (STABLE,))
    save(single, tmp_path / "claim.json")
    assert same(single, load(tmp_path / "claim.json"))


def test_nothing_that_can_be_claimed_is_missing_from_the_table():
    """Every claim, multiplier, uncertainty and set that the package exports can be saved."""
    import inc_casadi
    from inc_casadi import claims, multipliers, sets, uncertainty
    from inc_casadi.activations.base import Activation
    bases = (claims.Claim, multipliers.Multiplier, uncertainty.Uncertainty, Activation)
    for module in (inc_casadi, claims, multipliers, sets, uncertainty):
        for name in module.__all__:
            kind = getattr(module, name)
            if isinstance(kind, type) and issubclass(kind, bases) and kind not in bases:
                assert kind in KINDS, name


def signed(content):
    """The content with the digest that belongs to it, as an adversary would write it."""
    held = {key: value for key, value in content.items() if key not in ("format", "version", "digest")}
    try:
        return content | {"digest": digest(held)}
    except ValueError:  # not a finite number: no digest to forge
        return content


def altered(tmp_path, change, finish=signed):
    path = tmp_path / "paper.json"
    PAPER.save(path)
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(finish(content)))
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
    (pop(["format"]), "format"), (put(["format"], "onnx"), "format"), (put(["version"], 1), "version 1"),
    (put(["version"], 3), "version 3"), (put(["version"], True), "version True"), (pop(["version"]), "version None"),
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


def leaves(content, keys=()):
    """Where every number, string and empty entry of JSON content stands."""
    if isinstance(content, dict) and content:
        return [leaf for key, entry in content.items() for leaf in leaves(entry, (*keys, key))]
    if isinstance(content, list) and content:
        return [leaf for i, entry in enumerate(content) for leaf in leaves(entry, (*keys, i))]
    return [(keys, content)]


def others(value):
    """What a hand or an accident may turn an entry into."""
    if isinstance(value, str):
        return [value + " ", value[:-1] + "?" if value else "x", None]
    if isinstance(value, bool) or value is None:
        return [not value, 0, "x"]
    if isinstance(value, int | float):
        return [float(np.nextafter(value, np.inf)), -value if value else -0.0, value + 1, 0.99 * value + 1e-3,
                int(value) if isinstance(value, float) else float(value), str(value), None, [value]]
    return [None, [0.0], {}, "x"]


def test_a_file_in_which_anything_was_altered_is_refused(tmp_path):
    PAPER.save(tmp_path / "paper.json")
    content = json.loads((tmp_path / "paper.json").read_text())
    places = leaves(content)
    assert len(places) > 40
    seen = set()
    for keys, value in places:
        for other in others(value):
            if type(other) is type(value) and json.dumps(other) == json.dumps(value):
                continue
            message = {"format": "format", "version": "version", "digest": "was altered"}.get(keys[0], "was altered")
            with pytest.raises(FormatError, match=message):
                load(altered(tmp_path, put(keys, other), finish=dict))
            seen.add(keys[0])
    assert seen == {"format", "version", "digest", "kind", "data"}


def test_missing_extra_and_reordered_entries(tmp_path):
    for change in (pop(["digest"]), pop(["data", "note"]), put(["extra"], 1), put(["data", "plant", "data", "D"], [0.0])):
        with pytest.raises(FormatError, match="was altered"):
            load(altered(tmp_path, change, finish=dict))
    path = altered(tmp_path, lambda content: content["data"].update(plant=content["data"].pop("plant")), finish=dict)
    assert same(load(path), PAPER)  # order and spaces are not content


def test_numbers_too_large_for_a_double_are_refused(tmp_path):
    PAPER.save(tmp_path / "paper.json")
    text = (tmp_path / "paper.json").read_text()
    (tmp_path / "paper.json").write_text(text.replace("1.3006", "1e999"))
    with pytest.raises(FormatError, match="not finite"):
        load(tmp_path / "paper.json")


def check_promise(certificate):
    """What a certificate of a discounted cost says is true of motions, and its number follows from its own values."""
    plant, inc, claim, P = certificate.plant, certificate.inc, certificate.claim, certificate.values["P"].item()
    low, high = claim.initial.support.lower.item(), claim.initial.support.upper.item()
    bound = P * (low**2 + low * high + high**2) / 3
    stated = [float(figure) for figure in re.findall(r"\d+\.\d+|\d+", certificate.sentence.replace("x0", ""))]
    assert any(bound * (1 - 1e-12) <= figure <= bound * (1 + 1e-6) for figure in stated)
    start = np.array([[-3.0, -0.1, 0.5, 2.0]])
    x, cost = start, 0.0
    for k in range(100):
        u = inc(plant.C @ x)
        cost = cost + claim.discount**k * (claim.Q.item() * x**2 + claim.R.item() * u**2)
        x = plant.A @ x + plant.B @ u
    assert np.all(cost <= P * start**2 * (1 + 1e-12))


def test_a_forged_digest_makes_nothing_false_provable(tmp_path):
    PAPER.save(tmp_path / "paper.json")
    content = json.loads((tmp_path / "paper.json").read_text())
    outcomes = {"refused": 0, "not proved": 0, "proved": 0}
    for keys, value in leaves({"data": content["data"]}):
        if isinstance(value, bool) or not isinstance(value, int | float):
            continue
        for other in (1.02 * value, 0.98 * value, -value, value + 1.0, value - 0.05, 0.0, 1e-8, 1e8):
            forged = copy.deepcopy(content)
            put(keys, other)(forged)
            (tmp_path / "forged.json").write_text(json.dumps(signed(forged)))
            try:
                certificate = load(tmp_path / "forged.json")
            except FormatError:
                outcomes["refused"] += 1
                continue
            proved = bool(certificate.prove())
            assert certificate.holds() or not proved
            outcomes["proved" if proved else "not proved"] += 1
            if certificate.holds():
                check_promise(certificate)
            else:
                assert certificate.sentence.startswith("Not certified")
    assert outcomes["refused"] > 20 and outcomes["not proved"] > 50 and outcomes["proved"] > 10


def test_a_changed_number_with_a_forged_digest_is_read_but_proves_nothing(tmp_path):
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
    for thing in (3, {"A": object()}, {"A": np.array([np.inf])}, np.eye(2), object()):
        with pytest.raises(FormatError, match="cannot be saved"):
            save(thing, tmp_path / "x.json")
    assert not (tmp_path / "x.json").exists()
