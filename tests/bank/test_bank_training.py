"""Training: its schedule and loss by hand, and that stopping it at any moment changes nothing."""

from pathlib import Path

import numpy as np
import pytest
import torch
import torch.nn.functional as F

from sfkit.bank.plan import TrainingPlan
from sfkit.bank.training import Trained, batch_of, learning_rate, new_network, stage_loss, train
from sfkit.datasets.synthetic import domains

TINY = TrainingPlan(steps=4, peak_rate=1e-3, scenes=4, batch=2, warm_up=2, save_every=2)
HAZE = domains()["haze"]


class StoppedError(Exception):
    """What ends a training from outside."""


def stop_at(step: int) -> object:
    """A progress function that ends the training once ``step`` steps are saved."""

    def progress(what: str, done: int, of: int) -> None:
        if done == step and "loss" in what:
            raise StoppedError

    return progress


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Trained:
    return train(HAZE, TINY, None, tmp_path_factory.mktemp("whole") / "state.pt")


def test_a_stopped_training_ends_bit_identically(tmp_path: Path, whole: Trained) -> None:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # with more, sums are split differently from run to run
    try:
        straight = train(HAZE, TINY, None, tmp_path / "straight.pt")
        with pytest.raises(StoppedError):
            train(HAZE, TINY, None, tmp_path / "state.pt", stop_at(2))  # type: ignore[arg-type]
        assert torch.load(tmp_path / "state.pt", weights_only=True)["step"] == 2
        resumed = train(HAZE, TINY, None, tmp_path / "state.pt")
    finally:
        torch.set_num_threads(threads)
    assert resumed.final_loss == straight.final_loss
    for key, value in straight.weights.items():
        assert torch.equal(resumed.weights[key], value), key
    assert resumed.seconds > 0


def test_training_moves_the_weights_and_counts(whole: Trained) -> None:
    start = new_network(TINY.seed).state_dict()
    assert set(whole.weights) == set(start)
    assert any(not torch.equal(whole.weights[key], start[key]) for key in start)
    assert whole.steps == 4
    assert np.isfinite(whole.final_loss)


def test_a_finished_training_renders_nothing_again(tmp_path: Path) -> None:
    plan = TrainingPlan(steps=2, peak_rate=1e-3, scenes=2, batch=2, save_every=2)
    train(HAZE, plan, None, tmp_path / "state.pt")
    heard = []
    train(HAZE, plan, None, tmp_path / "state.pt", lambda *what: heard.append(what))
    assert heard == []


def test_training_starts_from_the_given_weights(tmp_path: Path, whole: Trained) -> None:
    nothing = TrainingPlan(steps=1, peak_rate=0.0, scenes=2, batch=2)
    trained = train(HAZE, nothing, whole.weights, tmp_path / "state.pt")
    for key, value in whole.weights.items():
        if "running" not in key and "num_batches" not in key:
            assert torch.equal(trained.weights[key], value), key


def test_new_networks_come_from_the_seed_and_leave_the_global_state_alone() -> None:
    before = torch.get_rng_state()
    one, same, other = (new_network(seed).state_dict() for seed in (1, 1, 2))
    assert torch.equal(torch.get_rng_state(), before)
    assert all(torch.equal(one[key], same[key]) for key in one)
    assert any(not torch.equal(one[key], other[key]) for key in one)


def test_an_epoch_sees_every_scene_once() -> None:
    plan = TrainingPlan(steps=10, peak_rate=1.0, scenes=12, batch=3)
    for epoch in (0, 1):
        seen = np.concatenate([batch_of(plan, 4 * epoch + k) for k in range(4)])
        assert sorted(seen) == list(range(12))
    assert not np.array_equal(batch_of(plan, 0), batch_of(plan, 4))


def test_learning_rate_by_hand() -> None:
    plan = TrainingPlan(steps=110, peak_rate=2.0, scenes=6, warm_up=10)
    assert learning_rate(plan, 0) == pytest.approx(0.2)
    assert learning_rate(plan, 9) == pytest.approx(2.0)
    assert learning_rate(plan, 10) == pytest.approx(2.0)
    assert learning_rate(plan, 60) == pytest.approx(1.0)
    assert learning_rate(plan, 109) == pytest.approx(0.0, abs=1e-3)


def test_stage_loss_by_hand() -> None:
    truth = torch.tensor([[[1.0, float("nan")], [4.0, 2.0]]])
    stages = [truth.nan_to_num(99.0) + off for off in (3.0, 0.5, 0.0)]
    # Smooth L1: 3 - 0.5 = 2.5 beyond one pixel, 0.5 * 0.5^2 = 0.125 within it.
    assert float(stage_loss(stages, truth)) == pytest.approx(0.25 * 2.5 + 0.5 * 0.125)


def test_stage_loss_equals_torch_where_all_is_known() -> None:
    generator = torch.Generator().manual_seed(0)
    truth, *stages = (torch.rand(2, 5, 7, generator=generator) * 9 for _ in range(4))
    expected = sum(w * F.smooth_l1_loss(s, truth) for w, s in zip((0.25, 0.5, 1.0), stages, strict=True))
    assert float(stage_loss(stages, truth)) == pytest.approx(float(expected), rel=1e-5)
