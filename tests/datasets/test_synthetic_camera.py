"""What the camera adds, each by its formula."""

import numpy as np
import pytest
from numpy.random import default_rng

from sfkit.datasets.synthetic.camera import Response, Weather, photograph, scan_lines
from sfkit.datasets.synthetic.textures import KINDS, TILE, ground_skin, skin, tile

GREY = np.full((40, 60, 3), 0.4)
NEAR = np.full((40, 60), 20.0)
CLEAR = Weather()


def test_an_ideal_camera_only_quantises() -> None:
    picture = photograph(GREY, NEAR, CLEAR, Response(), False, default_rng(0))
    assert picture.dtype == np.uint8
    assert (picture == 102).all()


def test_gain_gamma_and_tint_by_hand() -> None:
    response = Response(gain=(0.5, 1.0, 2.0), gamma=2.0)
    picture = photograph(GREY, NEAR, CLEAR, response, False, default_rng(0))
    assert picture[0, 0].tolist() == [round(255 * 0.2**2), round(255 * 0.4**2), round(255 * 0.8**2)]


def test_haze_hides_what_is_far() -> None:
    weather = Weather(density=2.0, light=(1.0, 1.0, 1.0))
    disparity = np.concatenate([np.full((40, 30), 20.0), np.full((40, 30), 2.0)], axis=1)
    picture = photograph(GREY, disparity, weather, Response(), False, default_rng(0))
    for column, passed in ((0, np.exp(-1.0)), (59, np.exp(-10.0))):
        assert picture[0, column, 0] == round(255 * (0.4 * passed + 1 - passed))


def test_noise_has_the_stated_deviation() -> None:
    picture = photograph(
        np.full((200, 200, 3), 0.5), np.ones((200, 200)), CLEAR, Response(noise=8.0), False, default_rng(1)
    )
    assert picture.std() == pytest.approx(8.0, rel=0.03)  # mid-grey: 0.3 + 1.4 / 2 = 1
    assert picture[..., 0].std() > 0
    assert not (picture[..., 0] == picture[..., 1]).all()


def test_grey_film_has_one_channel_with_its_noise() -> None:
    colourful = default_rng(2).uniform(size=(40, 60, 3))
    picture = photograph(colourful, NEAR, CLEAR, Response(noise=5.0), True, default_rng(1))
    assert (picture[..., 0] == picture[..., 1]).all()
    assert (picture[..., 0] == picture[..., 2]).all()


def test_blur_keeps_the_mean_and_flattens() -> None:
    fine = default_rng(3).uniform(size=(60, 60, 3))
    sharp, soft = (
        photograph(fine, np.ones((60, 60)), CLEAR, Response(blur=b), False, default_rng(0))
        for b in (0.0, 2.0)
    )
    assert soft.mean() == pytest.approx(sharp.mean(), abs=2.0)
    assert soft.std() < 0.3 * sharp.std()


def test_scan_lines_are_every_third_row_at_the_stated_density() -> None:
    mask = scan_lines(192, 384, 0.2, default_rng(4))
    rows = np.flatnonzero(mask.any(axis=1))
    assert (np.diff(rows) == 3).all()
    assert mask.mean() == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("kind", KINDS)
def test_tiles_are_colours_and_skins_are_continuous(kind: str) -> None:
    texture = tile(kind, default_rng(5), 1.0)
    assert texture.shape == (TILE, TILE, 3)
    assert texture.min() >= 0.0
    assert texture.max() <= 1.0
    x, y = default_rng(6).uniform(-2000.0, 2000.0, size=(2, 500))
    for colours in (skin(texture, 0.7, 0.3, (5.0, 9.0)), ground_skin(texture, 40.0, 90.0, (5.0, 9.0))):
        apart = np.abs(colours(x, y) - colours(x + 1e-7, y)).max()
        assert apart < 1e-4


def test_bilinear_sampling_by_hand() -> None:
    texture = np.zeros((TILE, TILE, 3))
    texture[10, 20] = 1.0
    at = skin(texture, 1.0, 0.0, (0.0, 0.0))
    seen = at(np.array([20.0, 20.25, 20.25, -20.0]), np.array([10.0, 10.0, 9.5, 10.0]))[:, 0]
    assert seen.tolist() == [1.0, 0.75, 0.375, 1.0]  # the last one mirrored at the tile's edge


def test_paint_is_plainer_than_print() -> None:
    def variation(kind: str) -> float:
        tiles = [tile(kind, default_rng(seed), 1.0) for seed in range(4)]
        return float(np.mean([np.abs(np.diff(t, axis=1)).mean() for t in tiles]))

    assert variation("paint") < 0.3 * variation("print")
