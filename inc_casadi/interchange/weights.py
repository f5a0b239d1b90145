"""Feedforward networks from the weights of other libraries, as plain arrays: none of them is imported."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..activations import Activation
from ..arrays import Array, matrix, vector
from ..errors import DimensionError, InvalidInputError, TranslationError
from ..inc import INC
from ..sets import Box
from .scaling import Scaling, scaled

Layer = tuple[str, Array, Array]
"""Name, weight (out, in) and bias (out,)."""


def from_state_dict(parameters: Mapping[str, Any], activation: Activation | Sequence[Activation], *,
                    output: Activation | Box | None = None, prefix: str | tuple[str, ...] = "",
                    input_scaling: Scaling | None = None, output_scaling: Scaling | None = None) -> INC:
    """Return the network of a PyTorch `state_dict` of linear layers in sequence as an INC.

    Entries "<name>.weight" (out, in) and "<name>.bias" (out,), zero where left out, are layers
    h = phi(weight h_before + bias); the last one is linear unless `output` says otherwise. They stand in the order of the
    mapping, or by number where all names are one word and a number, such as "net.0" and "net.10". A state_dict does not
    say which activation stands between them: that is to be told.

    Parameters
    ----------
    parameters : names to tensors or arrays; a tensor is read by detach(), cpu(), double() and numpy()
    activation : that of all hidden layers, or one for each
    output : an activation after the last layer, such as Tanh() or Saturation(); or a Box in R^m, in the units of u, to which
        the output is clipped after all scaling (`INC.with_saturated_output`)
    prefix : of the names to read, "actor." say, or several, as ("mlp_extractor.policy_net.", "action_net."); other names are
        left alone
    input_scaling, output_scaling : (mean, std) of the data that the network was trained on, u = mean + std * network
        ((y - mean) / std) with the output's activation before its scaling (`scaling.scaled`)

    Raises
    ------
    DimensionError, InvalidInputError : sizes that do not fit, by name
    TranslationError : an entry that is no weight or bias of a linear layer

    Examples
    --------
    >>> from inc_casadi import ReLU
    >>> net = from_state_dict({"0.weight": np.array([[1.0, -1.0]]), "0.bias": np.array([0.5]),
    ...                        "2.weight": np.array([[2.0]]), "2.bias": np.array([1.0])}, ReLU())
    >>> net([3.0, 1.0]).tolist()
    [6.0]
    """
    if not isinstance(parameters, Mapping):
        hint = ": pass its state_dict()" if hasattr(parameters, "state_dict") else ""
        raise InvalidInputError(f"parameters must map names to arrays, not be of type {type(parameters).__name__}{hint}")
    arrays = {name: _array(name, value) for name, value in parameters.items() if name.startswith(prefix)}
    odd = [name for name in arrays if name.rpartition(".")[2] not in ("weight", "bias")]
    if odd:
        raise TranslationError(f"parameters has {odd[0]!r}, which is neither weight nor bias of a linear layer: only "
                               "sequences of such layers are read")
    names = _in_order(list(dict.fromkeys(name.rpartition(".")[0] for name in arrays)))
    layers = [_layer(name, arrays) for name in names]
    return _network(layers, activation, output, input_scaling, output_scaling)


def from_keras_weights(weights: Sequence[Any], activation: Activation | Sequence[Activation], *,
                       output: Activation | Box | None = None, input_scaling: Scaling | None = None,
                       output_scaling: Scaling | None = None) -> INC:
    """Return the network of Dense layers whose `get_weights()` is [W_1 (in, out), b_1 (out,), W_2, b_2, ...] as an INC.

    A weight that another weight follows has no bias (use_bias=False). All else as in `from_state_dict`.

    Raises
    ------
    DimensionError, InvalidInputError : sizes that do not fit, by the number of the layer
    TranslationError : an array that is no weight or bias

    Examples
    --------
    >>> from inc_casadi import ReLU
    >>> net = from_keras_weights([[[1.0], [-1.0]], [0.5], [[2.0]], [1.0]], ReLU())
    >>> net([3.0, 1.0]).tolist()
    [6.0]
    """
    layers: list[Layer] = []
    bias_may_follow = False
    for i, given in enumerate(weights):
        array = _array(f"weights[{i}]", given)
        if array.ndim == 2:
            name = f"layer {len(layers) + 1} (weights[{i}])"
            layers.append((name, matrix(f"weights[{i}]", array.T), np.zeros(array.shape[1])))
        elif array.ndim == 1 and bias_may_follow:
            name, weight, _ = layers[-1]
            layers[-1] = (name, weight, vector(f"bias of {name}", array, weight.shape[0]))
        else:
            raise TranslationError(f"weights[{i}] has shape {array.shape}, but must be a matrix (in, out), or a bias (out,) "
                                   "right after its matrix")
        bias_may_follow = array.ndim == 2
    return _network(layers, activation, output, input_scaling, output_scaling)


def _array(name: str, value: Any) -> Array:
    for method in ("detach", "cpu", "double", "numpy"):  # a tensor; NumPy has no bfloat16, and arrays none of these
        value = getattr(value, method)() if hasattr(value, method) else value
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"{name} is not an array of numbers: {error}") from error


def _in_order(names: list[str]) -> list[str]:
    parts = [re.fullmatch(r"(.*?)(\d+)", name) for name in names]
    if any(part is None for part in parts) or len({part[1] for part in parts if part}) != 1:
        return names
    return sorted(names, key=lambda name: int(re.findall(r"\d+$", name)[0]))


def _layer(name: str, arrays: Mapping[str, Array]) -> Layer:
    weight, bias = (f"{name}.{part}" if name else part for part in ("weight", "bias"))
    if weight not in arrays:
        raise TranslationError(f"parameters has {bias!r}, but no {weight!r}")
    if arrays[weight].ndim != 2:
        raise TranslationError(f"{weight!r} has shape {arrays[weight].shape}, but that of a linear layer is (out, in)")
    rows = matrix(weight, arrays[weight])
    return name or "layer", rows, vector(bias, arrays.get(bias, np.zeros(len(rows))), len(rows))


def _network(layers: list[Layer], activation: Activation | Sequence[Activation], output: Activation | Box | None,
             input_scaling: Scaling | None, output_scaling: Scaling | None) -> INC:
    if not layers:
        raise InvalidInputError("there are no layers: a network needs at least its linear output layer")
    for (before, first, _), (name, second, _) in zip(layers, layers[1:], strict=False):
        if second.shape[1] != first.shape[0]:
            raise DimensionError(f"{name!r} reads {second.shape[1]} values, but {before!r} before it gives {first.shape[0]}")
    if not isinstance(output, Activation | Box | None):
        raise InvalidInputError(f"output must be an Activation, a Box or None, not {output!r}")
    kinds = _kinds(activation, len(layers) - 1)
    stacked = [(weight, bias) for _, weight, bias in layers]
    if isinstance(output, Activation):  # the last layer is one more hidden layer, which the output passes on
        size = len(stacked[-1][1])
        stacked, kinds = [*stacked, (np.eye(size), np.zeros(size))], [*kinds, output]
    units = [kind for kind, (weight, _) in zip(kinds, stacked, strict=False) for _ in range(len(weight))]
    bare = INC.from_layers(stacked)
    law = scaled(INC(bare.W, bare.U, bare.V, bare.K, bare.b, bare.d, tuple(units)), input_scaling, output_scaling)
    return law.with_saturated_output(output) if isinstance(output, Box) else law


def _kinds(activation: Activation | Sequence[Activation], hidden: int) -> list[Activation]:
    kinds = [activation] * hidden if isinstance(activation, Activation) else list(activation)
    for kind in kinds:
        if not isinstance(kind, Activation):
            raise InvalidInputError(f"activation must be an Activation such as ReLU(), not {kind!r}")
    if len(kinds) != hidden:
        raise DimensionError(f"activation has {len(kinds)} entries, but there are {hidden} hidden layers")
    return kinds
