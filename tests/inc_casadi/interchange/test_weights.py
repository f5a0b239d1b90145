"""Networks from weights of PyTorch and Keras, as mappings and lists of arrays, normalized data included."""

import numpy as np
import pytest

from inc_casadi import INC, Box, ReLU, Saturation, Tanh
from inc_casadi.errors import DimensionError, InvalidInputError, TranslationError
from inc_casadi.interchange import from_keras_weights, from_state_dict, scaled

RNG = np.random.default_rng(11)
W1, b1, W2, b2, W3, b3 = (RNG.normal(size=size) for size in ((5, 3), 5, (4, 5), 4, (2, 4), 2))
TORCH = {"net.0.weight": W1, "net.0.bias": b1, "net.2.weight": W2, "net.2.bias": b2, "net.4.weight": W3, "net.4.bias": b3}
KERAS = [W1.T, b1, W2.T, b2, W3.T, b3]
POINTS = RNG.normal(size=(3, 50))


def forward(y, phi, last=lambda z: z):
    """The network as its layers say, without INC."""
    h = phi(W1 @ y + b1[:, None])
    return last(W3 @ phi(W2 @ h + b2[:, None]) + b3[:, None])


class Tensor:
    """What a tensor offers, and no more: NumPy cannot read it without being told."""

    def __init__(self, values, steps=("detach", "cpu", "double", "numpy")):
        self.values, self.steps = values, steps

    def __array__(self, *_, **__):
        raise RuntimeError("can't convert: call detach() and cpu() first")

    def detach(self):
        assert self.steps[0] == "detach"
        return Tensor(self.values, self.steps[1:])

    def cpu(self):
        assert self.steps[0] == "cpu"
        return Tensor(self.values, self.steps[1:])

    def double(self):
        assert self.steps[0] == "double"
        return Tensor(self.values, self.steps[1:])

    def numpy(self):
        assert self.steps[0] == "numpy"
        return self.values


@pytest.mark.parametrize("wrap", [np.asarray, Tensor, lambda a: a.tolist(), lambda a: a.astype(np.float32)])
def test_a_state_dict_is_its_network(wrap):
    net = from_state_dict({name: wrap(value) for name, value in TORCH.items()}, Tanh())
    np.testing.assert_allclose(net(POINTS), forward(POINTS, np.tanh), rtol=1e-5, atol=1e-5)
    assert net.q == 9 and net.activations == (Tanh(),) * 9


def test_keras_weights_are_the_same_network():
    left, right = from_keras_weights(KERAS, Tanh()), from_state_dict(TORCH, Tanh())
    for part in ("W", "U", "V", "K", "b", "d"):
        np.testing.assert_array_equal(getattr(left, part), getattr(right, part))


def test_numbers_order_layers_and_words_keep_their_order():
    shuffled = {name: TORCH[name] for name in sorted(TORCH, reverse=True)}
    np.testing.assert_array_equal(from_state_dict(shuffled, Tanh()).W, from_state_dict(TORCH, Tanh()).W)
    ten = {name.replace("net.4", "net.10"): value for name, value in shuffled.items()}
    np.testing.assert_array_equal(from_state_dict(ten, Tanh()).V, from_state_dict(TORCH, Tanh()).V)
    words = {
        "inner.weight": W1,
        "inner.bias": b1,
        "core.weight": W2,
        "core.bias": b2,
        "action.weight": W3,
        "action.bias": b3,
    }
    np.testing.assert_array_equal(from_state_dict(words, Tanh()).W, from_state_dict(TORCH, Tanh()).W)


def test_a_prefix_picks_one_network_of_several():
    both = {f"actor.{name}": value for name, value in TORCH.items()} | {"critic.0.weight": np.ones((1, 3)), "log_std": b3}
    np.testing.assert_array_equal(from_state_dict(both, Tanh(), prefix="actor.").W, from_state_dict(TORCH, Tanh()).W)


def test_several_prefixes_pick_the_parts_of_one_network():
    """As Stable-Baselines names the layers of a policy."""
    names = {"net.0": "mlp_extractor.policy_net.0", "net.2": "mlp_extractor.policy_net.2", "net.4": "action_net"}
    parts = {"log_std": b3, "mlp_extractor.value_net.0.weight": np.ones((1, 3))}
    parts |= {f"{names[name.rpartition('.')[0]]}.{name.rpartition('.')[2]}": value for name, value in TORCH.items()}
    found = from_state_dict(parts, Tanh(), prefix=("mlp_extractor.policy_net.", "action_net."))
    np.testing.assert_array_equal(found.W, from_state_dict(TORCH, Tanh()).W)


def test_biases_may_be_left_out():
    bare = from_state_dict({name: value for name, value in TORCH.items() if name.endswith("weight")}, ReLU())
    assert not bare.b.any() and not bare.d.any()
    np.testing.assert_array_equal(from_keras_weights([W1.T, W2.T, W3.T], ReLU()).W, bare.W)
    some = from_keras_weights([W1.T, W2.T, b2, W3.T], ReLU())
    assert some.b.tolist() == [0.0] * 5 + b2.tolist()


def test_each_hidden_layer_may_have_its_activation():
    net = from_state_dict(TORCH, [ReLU(), Tanh()])
    assert net.activations == (ReLU(),) * 5 + (Tanh(),) * 4


def test_an_output_activation_and_an_output_box():
    squashed = from_state_dict(TORCH, ReLU(), output=Tanh())
    np.testing.assert_allclose(squashed(POINTS), forward(POINTS, lambda z: np.maximum(z, 0), np.tanh), rtol=1e-12)
    assert squashed.q == 11
    clipped = from_state_dict(TORCH, Tanh(), output=Saturation())
    np.testing.assert_allclose(clipped(POINTS), forward(POINTS, np.tanh, lambda z: np.clip(z, -1, 1)), rtol=1e-12)
    limited = from_state_dict(TORCH, Tanh(), output=Box([-0.5, 0.0], [0.5, 0.25]))
    expected = np.clip(forward(POINTS, np.tanh), [[-0.5], [0.0]], [[0.5], [0.25]])
    np.testing.assert_allclose(limited(POINTS), expected, rtol=1e-12, atol=1e-12)


MEAN_Y, STD_Y, MEAN_U, STD_U = (
    np.array([1.0, -20.0, 0.3]),
    np.array([0.1, 30.0, 2.0]),
    np.array([4.0, -1.0]),
    np.array([10.0, -2.0]),
)


def test_scalings_are_those_of_the_data():
    given = {"input_scaling": (MEAN_Y, STD_Y), "output_scaling": (MEAN_U, STD_U)}
    y = MEAN_Y[:, None] + STD_Y[:, None] * POINTS
    expected = MEAN_U[:, None] + STD_U[:, None] * forward(POINTS, np.tanh, np.tanh)
    for net in (
        from_state_dict(TORCH, Tanh(), output=Tanh(), **given),
        from_keras_weights(KERAS, Tanh(), output=Tanh(), **given),
    ):
        np.testing.assert_allclose(net(y), expected, rtol=1e-10, atol=1e-10)
    limited = from_state_dict(TORCH, Tanh(), output=Box([-1.0, -1.0], [5.0, 1.0]), **given)
    unclipped = MEAN_U[:, None] + STD_U[:, None] * forward(POINTS, np.tanh)
    np.testing.assert_allclose(limited(y), np.clip(unclipped, [[-1.0], [-1.0]], [[5.0], [1.0]]), rtol=1e-10, atol=1e-10)


def test_a_scaled_law_with_a_linear_path_and_a_loop():
    law = INC(
        [[0.2, -0.3], [0.1, 0.0]],
        RNG.normal(size=(2, 3)),
        RNG.normal(size=(2, 2)),
        RNG.normal(size=(2, 3)),
        [0.1, 0.2],
        [0.3, 0.4],
    )
    found = scaled(law, (MEAN_Y, STD_Y), (MEAN_U, STD_U))(MEAN_Y[:, None] + STD_Y[:, None] * POINTS)
    np.testing.assert_allclose(found, MEAN_U[:, None] + STD_U[:, None] * law(POINTS), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(scaled(law).U, law.U)


@pytest.mark.parametrize(("change", "error", "words"), [
    ({"net.2.weight": W2[:, :4]}, DimensionError, "'net.2' reads 4 values, but 'net.0' before it gives 5"),
    ({"net.2.bias": b1}, DimensionError, r"net.2.bias has shape \(5,\), but must be a vector of size 4"),
    ({"net.2.weight": np.ones((2, 2, 3, 3))}, TranslationError, r"'net.2.weight' has shape \(2, 2, 3, 3\)"),
    ({"net.1.running_mean": b1}, TranslationError, "'net.1.running_mean', which is neither"),
    ({"net.6.bias": b1}, TranslationError, "'net.6.bias', but no 'net.6.weight'"),
    ({"net.2.weight": np.full((4, 5), np.nan)}, InvalidInputError, "net.2.weight holds a NaN"),
    ({"net.2.weight": "words"}, InvalidInputError, "net.2.weight is not an array"),
])
def test_what_does_not_fit_is_named(change, error, words):
    with pytest.raises(error, match=words):
        from_state_dict(TORCH | change, Tanh())


@pytest.mark.parametrize(("weights", "error", "words"), [
    ([b1, W1.T], TranslationError, r"weights\[0\] has shape \(5,\)"),
    ([W1.T, b1, b1], TranslationError, r"weights\[2\] has shape \(5,\)"),
    ([W1.T, b2], DimensionError, r"bias of layer 1 \(weights\[0\]\) has shape \(4,\)"),
    ([W1.T, b1, W3.T], DimensionError, r"'layer 2 \(weights\[2\]\)' reads 4 values, but 'layer 1"),
    ([], InvalidInputError, "no layers"),
])
def test_keras_lists_that_do_not_fit_are_named(weights, error, words):
    with pytest.raises(error, match=words):
        from_keras_weights(weights, Tanh())


def test_other_arguments_that_are_wrong():
    for arguments, error, words in (
        ({"activation": [Tanh()]}, DimensionError, "1 entries, but there are 2"),
        ({"activation": "tanh"}, InvalidInputError, "must be an Activation"),
        ({"activation": Tanh(), "output": "tanh"}, InvalidInputError, "output must be"),
        ({"activation": Tanh(), "input_scaling": 3.0}, InvalidInputError, "pair"),
        ({"activation": Tanh(), "input_scaling": (0.0, 0.0)}, InvalidInputError, "positive"),
        ({"activation": Tanh(), "output_scaling": (0.0, [1.0, 0.0])}, InvalidInputError, "zero"),
        ({"activation": Tanh(), "input_scaling": ([1.0, 2.0], 1.0)}, DimensionError, "mean of the input"),
    ):
        with pytest.raises(error, match=words):
            from_state_dict(TORCH, **arguments)
    with pytest.raises(InvalidInputError, match="map names"):
        from_state_dict([W1, b1], Tanh())
    with pytest.raises(InvalidInputError, match=r"type Module: pass its state_dict\(\)"):
        from_state_dict(type("Module", (), {"state_dict": lambda self: TORCH})(), Tanh())
