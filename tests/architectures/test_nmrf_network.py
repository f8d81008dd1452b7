"""NMRF as a whole: input conventions, batches, precisions, ranges, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from nmrf_fill import fill

from sfkit.architectures import NMRF, architecture
from sfkit.errors import InputError

NAMES = ("nmrf-res", "nmrf-swint")
SIZE = (64, 96)


def _network(name: str, **options: object) -> NMRF:
    network = architecture(name).build(**options)
    assert isinstance(network, NMRF)
    fill(network, "B")
    return network.eval()


@pytest.fixture(scope="module")
def networks() -> dict[str, NMRF]:
    return {name: _network(name) for name in NAMES}


def _pair(seed: int = 0, size: tuple[int, int] = SIZE) -> tuple[np.ndarray, np.ndarray]:
    """A noisy texture and itself, 5 pixels to the left."""
    rng = np.random.default_rng(seed)
    texture = rng.integers(0, 256, (size[0], size[1] + 5, 3), dtype=np.uint8)
    return texture[:, :-5], texture[:, 5:]


def _tensors(seed: int = 0) -> list[torch.Tensor]:
    return [torch.from_numpy(i.copy()).permute(2, 0, 1)[None].float() for i in _pair(seed)]


@pytest.mark.parametrize("name", NAMES)
def test_forward_is_the_records_disparity(networks: dict[str, NMRF], name: str) -> None:
    left, right = _tensors()
    with torch.no_grad():
        estimate = networks[name].estimate(left, right)
        assert torch.equal(networks[name](left, right), estimate.disp)
    cells = SIZE[0] * SIZE[1] // 64
    assert estimate.disp.shape == (1, *SIZE)
    assert torch.equal(estimate.disp, 4 * estimate.disp_pred)
    assert (estimate.disp >= 0).all()
    assert estimate.proposal.shape == estimate.initial_proposal.shape == (1, cells, 4)
    assert (estimate.initial_proposal == estimate.initial_proposal.round()).all()
    assert estimate.prob.shape == (cells, 40)
    assert torch.allclose(estimate.prob.sum(-1), torch.ones(cells))
    assert estimate.aux_coarse == estimate.aux_refined == ()


@pytest.mark.parametrize("name", NAMES)
def test_training_and_evaluation_mode_give_the_same_disparity(networks: dict[str, NMRF], name: str) -> None:
    left, right = _tensors()
    with torch.no_grad():
        seeds = networks[name].estimate(left, right).initial_proposal
        evaluated = networks[name].double().estimate(left.double(), right.double(), seeds=seeds)
        trained = networks[name].train().estimate(left.double(), right.double(), seeds=seeds)
    networks[name].float().eval()
    assert torch.allclose(trained.disp, evaluated.disp, atol=1e-8)
    assert [c.disp_pred.shape for c in trained.aux_coarse] == [(1, *SIZE, 4)] * 5
    assert [c.logits_pred.shape for c in trained.aux_coarse] == [(1, *SIZE, 4)] * 5
    assert [d.shape for d in trained.aux_refined] == [(1, *SIZE)] * 4


def test_scores_are_a_quarter_of_their_heads_output_sub_pixels_row_by_row() -> None:
    network = _network("nmrf-res").train()
    torch.nn.init.zeros_(network.infer_score_head.weight)
    network.infer_score_head.bias.data = torch.arange(64.0)
    with torch.no_grad():
        logits = network.estimate(*_tensors()).aux_coarse[0].logits_pred
    assert torch.equal(logits[0, 8:16, 24:32, 3], torch.arange(64.0).reshape(8, 8) / 4)


def test_batch_equals_its_images_one_by_one(networks: dict[str, NMRF]) -> None:
    network = networks["nmrf-res"].double()
    pairs = [[x.double() for x in _tensors(seed)] for seed in (1, 2)]
    with torch.no_grad():
        alone = [network.estimate(*pair) for pair in pairs]
        seeds = torch.cat([e.initial_proposal for e in alone])
        left, right = (torch.cat(side) for side in zip(*pairs, strict=True))
        together = network.estimate(left, right, seeds=seeds)
    network.float()
    assert torch.allclose(together.disp, torch.cat([e.disp for e in alone]), atol=1e-8)
    assert torch.allclose(together.prob, torch.cat([e.prob for e in alone]), atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_caller_and_network_normalise_alike_where_the_statistics_agree(
    networks: dict[str, NMRF], name: str
) -> None:
    entry = architecture(name)
    outside = _network(name, normalisation="caller")
    found = []
    for network, options in ((networks[name], {}), (outside, {"normalisation": "caller"})):
        pair = entry.inputs(entry.resolve(options)).prepare(*_pair())
        with torch.no_grad():
            found.append(network.estimate(pair.left, pair.right).prob)
    # Swin-T's own statistics are ImageNet's; the residual encoder's own range is -1..1.
    assert torch.allclose(*found, rtol=1e-4) == (name == "nmrf-swint")


@pytest.mark.parametrize(("name", "multiple"), [("nmrf-res", 8), ("nmrf-swint", 32)])
@pytest.mark.parametrize("normalisation", ["network", "caller"])
def test_input_convention_pads_below_and_right_whether_before_or_after_normalising(
    name: str, multiple: int, normalisation: str
) -> None:
    convention = architecture(name).inputs({"normalisation": normalisation})
    left, right = _pair(size=(33, 41))
    prepared = convention.prepare(left, right)
    height, width = 33 + -33 % multiple, 41 + -41 % multiple
    assert prepared.left.shape == (1, 3, height, width)
    padded = [np.pad(i, ((0, height - 33), (0, width - 41), (0, 0)), mode="edge") for i in (left, right)]
    assert torch.equal(prepared.left, convention.prepare(*padded).left)
    assert torch.equal(prepared.right, convention.prepare(*padded).right)
    if normalisation == "network":
        assert torch.equal(
            prepared.left[0, :, :33, :41], torch.from_numpy(left.copy()).permute(2, 0, 1).float()
        )


@pytest.mark.parametrize("name", NAMES)
def test_autocast_keeps_the_disparity_in_float32(networks: dict[str, NMRF], name: str) -> None:
    left, right = _tensors()
    with torch.no_grad(), torch.autocast("cpu", dtype=torch.bfloat16):
        estimate = networks[name].estimate(left, right)
    assert estimate.disp.dtype == estimate.proposal.dtype == estimate.prob.dtype == torch.float32
    assert torch.isfinite(estimate.disp).all()


def test_zero_shot_range_has_39_bins_and_the_same_parameters(networks: dict[str, NMRF]) -> None:
    short = _network("nmrf-res", max_disp=312)
    assert list(short.state_dict()) == list(networks["nmrf-res"].state_dict())
    with torch.no_grad():
        estimate = short.estimate(*_tensors())
        full = networks["nmrf-res"].estimate(*_tensors())
    assert estimate.prob.shape[-1] == 39
    assert estimate.initial_proposal.max() <= 38
    # The convolutions along the bins reach six bins far; before that the logits agree.
    ratio = (estimate.prob / full.prob[:, :39])[:, :33]
    assert torch.allclose(ratio, ratio[:, :1].expand_as(ratio), rtol=1e-4)


@pytest.mark.parametrize("max_disp", [0, 24, 100])
def test_unusable_range_is_refused(max_disp: int) -> None:
    with pytest.raises(InputError, match=f"max_disp is {max_disp}, expected a multiple of 8 of at least 32"):
        architecture("nmrf-res").build(max_disp=max_disp)


def test_unknown_normalisation_is_refused() -> None:
    with pytest.raises(InputError, match=r"unknown normalisation 'networ'.*did you mean 'network'"):
        architecture("nmrf-res").build(normalisation="networ")


@pytest.mark.parametrize(
    ("left", "right", "sentence"),
    [
        ((1, 3, 64, 96), (1, 3, 64, 128), "expected the same"),
        ((3, 64, 96), (3, 64, 96), "expected the same"),
        ((1, 1, 64, 96), (1, 1, 64, 96), "expected the same"),
        ((1, 3, 64, 100), (1, 3, 64, 100), "64 x 100, expected multiples of 8: pad them"),
    ],
)
def test_images_that_do_not_fit_are_refused(
    networks: dict[str, NMRF], left: tuple[int, ...], right: tuple[int, ...], sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        networks["nmrf-res"](torch.zeros(left), torch.zeros(right))


def test_seeds_that_do_not_fit_are_refused(networks: dict[str, NMRF]) -> None:
    left, right = _tensors()
    with pytest.raises(InputError, match=r"seeds are \(1, 96, 3\), expected \(1, 96, 4\)"):
        networks["nmrf-res"].estimate(left, right, seeds=torch.zeros(1, 96, 3))
    with pytest.raises(InputError, match=r"seeds range from 0 to 40, expected bins of 0 \.\. 39"):
        networks["nmrf-res"].estimate(left, right, seeds=torch.tensor([0, 1, 2, 40]).expand(1, 96, 4))


@pytest.mark.parametrize(("name", "scalars"), [("nmrf-res", 6_113_210), ("nmrf-swint", 32_548_116)])
def test_everything_lies_on_the_networks_device(name: str, scalars: int) -> None:
    """On the meta device, which refuses a tensor left on the CPU as a GPU would."""
    with torch.device("meta"):
        network = architecture(name).build()
    assert sum(p.numel() for p in network.parameters()) == scalars
    images = torch.zeros(2, 3, *SIZE, device="meta")
    disparity = network(images, images)
    assert disparity.device.type == "meta"
    assert disparity.shape == (2, *SIZE)
