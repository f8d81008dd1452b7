"""The renderer against geometry: warping, a brute-force z-buffer, hand-made scenes."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.typing import NDArray

from sfkit.datasets.synthetic import domains, shapes
from sfkit.datasets.synthetic.domains import worlds
from sfkit.datasets.synthetic.render import left_hits, render, right_hits
from sfkit.datasets.synthetic.scene import Composer
from sfkit.datasets.synthetic.surfaces import DisparityField, Surface
from sfkit.datasets.synthetic.textures import skin, tile

HEIGHT, WIDTH = 96, 192
ALL = {**domains(), **worlds()}
Map = NDArray[np.float64]


def scene(name: str, seed: int = 5) -> list[Surface]:
    """A drawn scene of the domain, small enough for brute force."""
    return Composer(ALL[name], HEIGHT, WIDTH, default_rng(seed)).compose()


def panel(level: float, box: tuple[float, float, float, float], slope: float = 0.0) -> Surface:
    """An upright textured panel of one disparity."""
    centre = ((box[0] + box[1]) / 2, (box[2] + box[3]) / 2)
    colours = skin(tile("cloud", default_rng(int(level)), 1.0), 0.7, 0.0, (level, level))
    return Surface(DisparityField(centre, level, slope), shapes.everywhere(), colours, box, (-99.0, 99.0))


def test_a_panel_before_a_wall_by_hand() -> None:
    wall, front = panel(4.0, (-99.0, 199.0, 0.0, 20.0)), panel(10.0, (40.0, 59.0, 5.0, 14.0))
    views = render([wall, front], 20, 100)
    assert views.disparity[10, 39:61].tolist() == [4.0] + [10.0] * 20 + [4.0]
    assert views.right_disparity[10, 29:51].tolist() == [4.0] + [10.0] * 20 + [4.0]
    # The wall hides for the difference of the disparities, 6 pixels left of the panel, and for 4 at the edge.
    assert np.flatnonzero(~views.visible[10]).tolist() == [0, 1, 2, 3, *range(34, 40)]
    assert np.flatnonzero(~views.visible[2]).tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("name", ALL)
def test_every_left_pixel_looks_the_same_at_its_right_position(name: str) -> None:
    """The continuous right view at x - d is the left view, to rounding, wherever both see the point."""
    surfaces = scene(name)
    views = render(surfaces, HEIGHT, WIDTH)
    landing = np.arange(WIDTH, dtype=np.float64) - views.disparity
    hits = right_hits(surfaces, landing)
    rows, columns = np.nonzero(views.visible)
    seen = np.zeros((len(rows), 3))
    winner = hits.surface[rows, columns]
    for index in np.unique(winner):
        at = winner == index
        seen[at] = surfaces[index].skin(hits.left_x[rows[at], columns[at]], rows[at].astype(np.float64))
    apart = np.abs(seen - views.left[rows, columns]).max(axis=1)
    # A silhouette's own points may fall a rounding error outside of it; then the surface behind shows.
    assert np.mean(apart > 1e-6) < 1e-3
    assert views.visible.mean() > 0.7


def warp(right: Map, disparity: Map) -> tuple[Map, NDArray[np.bool_]]:
    """The right image sampled linearly at x - d, and where both samples exist."""
    x = np.arange(right.shape[1]) - disparity
    left_of = np.floor(x).astype(int)
    share = (x - left_of)[..., None]
    inside = (left_of >= 0) & (left_of + 1 < right.shape[1])
    rows = np.arange(right.shape[0])[:, None]
    cell = np.clip(left_of, 0, right.shape[1] - 2)
    return right[rows, cell] * (1 - share) + right[rows, cell + 1] * share, inside


@pytest.mark.parametrize("name", ["plain", "open-ground", "slanted-walls", "courtyard"])
def test_warping_the_right_image_by_the_truth_reproduces_the_left(name: str) -> None:
    views = render(scene(name), HEIGHT, WIDTH)
    warped, inside = warp(views.right, views.disparity)
    steps = np.abs(np.diff(views.disparity, axis=1, prepend=views.disparity[:, :1]))
    smooth = (steps < 1.0) & (np.roll(steps, -1, axis=1) < 1.0)  # no silhouette between the two samples
    use = views.visible & inside & smooth
    assert use.mean() > 0.6
    error = np.abs(warped - views.left).mean(axis=2)[use]
    wrong, _ = warp(views.right, views.disparity + 1.5)
    assert np.mean(error) < 0.01  # linear interpolation of a band-limited texture; radiance is 0..1
    assert np.mean(error) < 0.2 * np.mean(np.abs(wrong - views.left).mean(axis=2)[use])


def brute_force_visible(surfaces: list[Surface], disparity: Map, step: float = 1 / 64) -> NDArray[np.bool_]:
    """Occlusion without any inverse: march along each row of every surface in steps far below a pixel."""
    height, width = disparity.shape
    visible = np.ones((height, width), dtype=bool)
    x = np.arange(-width, 2 * width, step)
    for row in range(height):
        y = np.full_like(x, float(row))
        landing = np.arange(width) - disparity[row]
        visible[row] &= (landing >= 0) & (landing <= width - 1)
        for surface in surfaces:
            d = surface.field.at(x, y)
            here = surface.covers(x, y, d)
            x_right = x - d
            # Between two covered neighbours the surface is there; it hides what it passes and lies behind it.
            joined = here[:-1] & here[1:] & (x_right[1:] > x_right[:-1])
            order = np.argsort(x_right[:-1][joined])
            low, high, depth = (a[joined][order] for a in (x_right[:-1], x_right[1:], d[:-1]))
            if len(low):
                at = np.clip(np.searchsorted(low, landing, side="right") - 1, 0, len(low) - 1)
                over = (landing >= low[at]) & (landing < high[at]) & (depth[at] > disparity[row] + 0.05)
                visible[row] &= ~over
    return visible


@pytest.mark.parametrize("name", ["plain", "thin-things", "slanted-walls", "scanned-street"])
def test_occlusion_equals_a_brute_force_z_buffer(name: str) -> None:
    surfaces = Composer(ALL[name], 24, WIDTH, default_rng(11)).compose()
    views = render(surfaces, 24, WIDTH)
    expected = brute_force_visible(surfaces, views.disparity)
    assert not expected.all()
    # Marching misses up to one step at each silhouette, nothing else.
    assert np.mean(expected != views.visible) < 2e-3


@pytest.mark.parametrize("name", ["plain", "indoor-rooms"])
def test_the_left_disparity_is_the_largest_of_all_surfaces(name: str) -> None:
    surfaces = scene(name)
    hits = left_hits(surfaces, HEIGHT, WIDTH)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)
    every = np.full((len(surfaces), HEIGHT, WIDTH), -np.inf)
    for k, surface in enumerate(surfaces):
        d = surface.field.at(x, y)
        every[k] = np.where(surface.covers(x, y, d), d, -np.inf)
    np.testing.assert_allclose(hits.disparity, every.max(axis=0))
    np.testing.assert_array_equal(hits.surface, every.argmax(axis=0))


@pytest.mark.parametrize("name", ALL)
def test_scenes_are_closed_and_keep_to_their_disparities(name: str) -> None:
    low, high = ALL[name].disparity
    views = render(scene(name), HEIGHT, WIDTH)
    for disparity in (views.disparity, views.right_disparity):
        assert np.isfinite(disparity).all()
        assert disparity.min() > 0.25 * min(low, 1.0)
        assert disparity.max() <= high + 1.0
