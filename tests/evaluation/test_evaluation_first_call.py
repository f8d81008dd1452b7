"""The usual mistakes of a new network: each is told at once, with the option that mends it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from own_networks import NETWORK, REGISTER, write_pool, write_states

import sfkit
from sfkit.architectures import code
from sfkit.architectures.registry import _REGISTRY
from sfkit.cli import main
from sfkit.evaluation.first_call import LARGER, SHIFT, SIZE, first_call, shifted_pair

# What the network's last line becomes -> the mistake, and what its sentence says.
OUTPUTS = {
    "list": ("return [value * 0, value]", "list", 'returns a list of 2: say output="last"'),
    "tuple": ("return value, None", "tuple", "returns a tuple of 2"),
    "dictionary": ('return {"disp_pred": value}', "dictionary", 'say output="key:disp_pred"'),
    "two channels": ("return torch.stack([-value, value * 0], 1)", "channels", 'say output="negated"'),
    "a quarter": ("return value[:, ::4, ::4] / 4", "resolution", "say resolution=4"),
    "negative": ("return -value", "sign", 'negative .* say output="negated"'),
    "normalised": ("return value / left.shape[-1]", "fraction", 'say output="fraction"'),
    "numpy": ("return value.numpy()", "type", "returns a ndarray: return a torch tensor"),
    "half": ("return value.half()", "half", r"torch.float16.*return output.float\(\)"),
    "random": ("return value + torch.rand_like(value)", "random", "two calls on one pair differ by"),
    "batch norm": ("return value", "training mode", "norm normalises by the batch it sees"),
    "gradients": ("value.sum().backward(); return value", "gradients", "only where gradients are recorded"),
    "size": (
        "value.reshape(len(value), left.shape[1] * 0 + 32, -1, value.shape[-1]); "
        "value.reshape(len(value), -1, value.shape[-1] // 32, 32); return value",
        "size",
        r"say inputs=InputConvention\(multiple=32\)",
    ),
    "not finite": ("return value * float('nan')", "finite", "not finite"),
    "broken": ("raise KeyError('disp')", "call", "the network failed .KeyError"),
}
PLAIN = "return (shares * steps[:, None, None]).sum(1)"


def pool_returning(folder: Path, end: str, name: str = "") -> sfkit.Pool:
    """A pool of the usual network with another end."""
    write_states(folder)
    text = NETWORK.replace(PLAIN, PLAIN.replace("return", "value = 1 +") + f"\n        {end}")
    if name == "batch norm":
        stubborn = "self.norm = nn.BatchNorm2d(3, affine=False, track_running_stats=False)"
        text = text.replace("super().__init__()", f"super().__init__()\n        {stubborn}")
    if name == "gradients":
        text = text.replace(
            "a, b = self.features", "left = left.clone().requires_grad_()\n        a, b = self.features"
        )
    (folder / "net.py").write_text(text + REGISTER)
    sfkit.trust_code(folder / "net.py")
    return sfkit.open_pool(write_pool(folder, 'architecture = "my-net"\nmodule = "net.py"'))


@pytest.fixture(autouse=True)
def trust_ends_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """What these tests trust, no other test does."""
    monkeypatch.setenv(code.TRUST, "")


@pytest.mark.parametrize("name", OUTPUTS)
def test_each_mistake_has_its_sentence(name: str, tmp_path: Path) -> None:
    end, mistake, sentence = OUTPUTS[name]
    called = first_call(pool_returning(tmp_path, end, name))
    assert [found.name for found in called.mistakes] == [mistake]
    assert re.search(sentence, called.mistakes[0].sentence), called.mistakes[0].sentence


def test_a_class_that_a_worker_cannot_import(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    namespace: dict[str, type] = {"__name__": "__main__"}
    exec(NETWORK, namespace)  # noqa: S102 (as in a notebook's cell)
    write_states(tmp_path)
    sfkit.register_architecture("cell-net", blocks={"all": ["*"]}, version="1")(namespace["MyNet"])
    try:
        called = first_call(sfkit.open_pool(write_pool(tmp_path, 'architecture = "cell-net"')))
    finally:
        del _REGISTRY["cell-net"]
    assert [found.name for found in called.mistakes] == ["import"]
    assert "a module that workers can import" in called.mistakes[0].sentence
    assert not called.mistakes[0].fatal


def test_a_sound_network_has_none_and_the_command_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pool = pool_returning(tmp_path, "return value")
    assert first_call(pool).mistakes == ()
    for end, code_ in (("return value", 0), ("return [value]", 1)):
        pool_returning(tmp_path, end)
        with pytest.raises(SystemExit) as ended:
            main(["check", str(tmp_path / "pool.toml"), "--trust-code"])
        assert ended.value.code == code_
        printed = capsys.readouterr().out
        assert ("is called rightly" in printed) is (code_ == 0)
        assert ('output="last"' in printed) is (code_ == 1)


def test_a_network_that_small_pairs_are_too_small_for_is_called_on_a_larger_one(tmp_path: Path) -> None:
    end = "torch.nn.functional.avg_pool2d(left, 256); return value"
    called = first_call(pool_returning(tmp_path, end))
    assert (called.mistakes, called.size) == ((), LARGER)
    # Costs for 48 shifts at a quarter of the width, as MobileStereoNet: no matter of multiples.
    shifts = "[left[..., 4 * d :].amax() for d in range(48)]; return value"
    assert first_call(pool_returning(tmp_path, shifts)).mistakes == ()
    assert first_call(pool_returning(tmp_path, "return value")).size == SIZE


def test_the_pair_is_shifted_by_what_it_says() -> None:
    left, right = shifted_pair()
    np.testing.assert_array_equal(left[:, SHIFT:], right[:, :-SHIFT])
