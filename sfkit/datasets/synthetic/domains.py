"""The synthetic worlds: what a domain may vary, and the table of the bank's domains and benchmarks.

A domain is named for what it is. The base domain is plain; every source domain differs from it along
one axis that real data sets differ along; the worlds of the benchmarks mix several.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

Range = tuple[float, float]


def _plain_textures() -> dict[str, float]:
    return {"cloud": 3.0, "grain": 2.0, "print": 3.0, "bricks": 1.0}


@dataclass(frozen=True)
class Domain:
    """What scenes of one world are drawn from; a (low, high) range is drawn from uniformly, once a scene.

    Attributes:
        name: what it is called.
        about: what it is, one line.
        disparity: smallest and largest disparity of a scene, pixels.
        backdrop: where in the disparity range the farthest plane lies, 0 at the smallest.
        objects: how many free-standing things, whole numbers.
        thin: how many poles, wires and fences, whole numbers.
        slant: steepest disparity slope of a surface, pixels per pixel.
        curved: share of things with a curved face.
        ground: share of scenes with a ground plane.
        walls: share of scenes between two receding walls.
        textures: kind (``textures.KINDS``) -> weight.
        contrast: of the textures, 1 is full.
        exposure: right view's gain and gamma differ by up to exp(+-exposure).
        brightness: gain of both views.
        noise: grey levels of 0..255.
        blur: Gaussian sigma in pixels; each view draws its own.
        haze: density, see ``camera.Weather``.
        grey: share of scenes on grey film.
        scanned: share of scenes whose ground truth is scan lines, not dense.
        scan_density: share of pixels a scan keeps.
    """

    name: str
    about: str
    disparity: Range = (2.0, 42.0)
    backdrop: Range = (0.0, 0.6)
    objects: tuple[int, int] = (4, 9)
    thin: tuple[int, int] = (0, 0)
    slant: float = 0.06
    curved: float = 0.2
    ground: float = 0.3
    walls: float = 0.0
    textures: Mapping[str, float] = field(default_factory=_plain_textures)
    contrast: Range = (0.7, 1.0)
    exposure: float = 0.0
    brightness: Range = (0.9, 1.1)
    noise: Range = (0.0, 2.0)
    blur: Range = (0.4, 0.6)
    haze: Range = (0.0, 0.0)
    grey: float = 0.0
    scanned: float = 0.0
    scan_density: Range = (0.1, 0.2)


BASE = Domain(
    "plain",
    "textured things at all depths before a textured backdrop, good light",
    backdrop=(0.0, 0.8),
    objects=(3, 7),
)

_WEAK = {"paint": 6.0, "cloud": 1.0}
_REPEATING = {"stripes": 2.0, "checks": 2.0, "bricks": 2.0, "cloud": 2.0}

SOURCES: tuple[Domain, ...] = (
    Domain(
        "far-scene",
        "small disparities only, under 10 pixels",
        backdrop=(0.0, 0.4),
        disparity=(0.5, 9.0),
        objects=(8, 14),
        ground=0.6,
    ),
    Domain(
        "bare-paint",
        "nearly plain surfaces with faint stains",
        textures=_WEAK,
        contrast=(0.5, 0.9),
        objects=(5, 9),
    ),
    Domain(
        "thin-things",
        "poles, wires and fences before everything",
        backdrop=(0.0, 0.3),
        thin=(6, 11),
        objects=(2, 4),
        ground=0.6,
        disparity=(3.0, 30.0),
    ),
    Domain(
        "slanted-walls",
        "receding walls, tilted and curved faces",
        backdrop=(0.0, 0.3),
        slant=0.32,
        curved=0.6,
        walls=0.8,
        ground=0.6,
        objects=(3, 6),
    ),
    Domain(
        "open-ground",
        "a ground plane to the horizon with things standing on it",
        backdrop=(0.0, 0.1),
        ground=1.0,
        objects=(3, 7),
        disparity=(1.0, 44.0),
        textures={"cloud": 2.0, "grain": 2.0, "checks": 1.0, "paint": 1.0},
    ),
    Domain(
        "uneven-exposure", "the right view darker, brighter or tinted", exposure=0.5, brightness=(0.7, 1.2)
    ),
    Domain(
        "sensor-noise",
        "dim light, slightly misty air, a noisy sensor",
        noise=(8.0, 16.0),
        brightness=(0.65, 1.05),
        haze=(0.0, 0.3),
    ),
    Domain("soft-focus", "both views out of focus, each by its own amount", blur=(1.2, 3.2)),
    Domain(
        "haze",
        "distance fades into bright air",
        backdrop=(0.0, 0.4),
        haze=(0.5, 1.4),
        disparity=(2.0, 32.0),
        ground=0.7,
        noise=(1.0, 3.0),
    ),
    Domain(
        "grey-pattern",
        "grey film, repeating patterns",
        grey=1.0,
        textures=_REPEATING,
        noise=(1.0, 4.0),
    ),
    Domain(
        "scanned-street",
        "a street known at scan lines only",
        backdrop=(0.0, 0.2),
        ground=1.0,
        walls=0.5,
        thin=(1, 4),
        objects=(2, 6),
        disparity=(1.0, 30.0),
        textures={"cloud": 2.0, "paint": 2.0, "bricks": 2.0, "print": 1.0},
        exposure=0.1,
        noise=(1.0, 4.0),
        scanned=1.0,
    ),
)

COURTYARD = Domain(
    "courtyard",
    "a bit of everything: paved ground, walls, railings, mixed light",
    backdrop=(0.0, 0.4),
    disparity=(2.0, 36.0),
    objects=(4, 8),
    thin=(0, 4),
    slant=0.15,
    ground=0.7,
    walls=0.3,
    textures={"cloud": 2.0, "grain": 1.0, "print": 2.0, "bricks": 2.0, "paint": 2.0, "stripes": 1.0},
    exposure=0.2,
    brightness=(0.6, 1.1),
    noise=(1.0, 10.0),
    blur=(0.4, 1.4),
    haze=(0.0, 0.3),
    grey=0.2,
)

BENCHMARKS: tuple[Domain, ...] = (
    COURTYARD,
    Domain(
        "indoor-rooms",
        "painted walls close by, curved things, uneven lamps",
        backdrop=(0.0, 0.3),
        disparity=(6.0, 42.0),
        objects=(3, 7),
        thin=(0, 2),
        slant=0.22,
        curved=0.5,
        ground=0.5,
        walls=0.6,
        textures={"paint": 4.0, "print": 2.0, "cloud": 2.0, "stripes": 1.0},
        exposure=0.25,
        brightness=(0.5, 1.0),
        noise=(2.0, 9.0),
    ),
    Domain(
        "hazy-road",
        "an open road in haze, known at scan lines only",
        backdrop=(0.0, 0.15),
        disparity=(1.0, 28.0),
        objects=(3, 7),
        thin=(1, 4),
        ground=1.0,
        walls=0.2,
        textures={"cloud": 3.0, "paint": 2.0, "bricks": 1.0, "grain": 1.0},
        exposure=0.15,
        noise=(2.0, 8.0),
        haze=(0.3, 0.9),
        scanned=1.0,
        scan_density=(0.2, 0.3),
    ),
    Domain(
        "grey-workshop",
        "racks, cables and repeating patterns on grey film, focus not quite right",
        disparity=(4.0, 32.0),
        objects=(4, 8),
        thin=(3, 8),
        slant=0.1,
        ground=0.3,
        textures={"stripes": 1.0, "checks": 1.0, "bricks": 2.0, "print": 2.0, "cloud": 2.0, "paint": 1.0},
        exposure=0.15,
        noise=(3.0, 12.0),
        blur=(0.5, 2.0),
        grey=1.0,
    ),
)

VALIDATION = COURTYARD.name
"""The benchmark that searches may look at; its first ``QUICK_PAIRS`` pairs are the quick one."""

QUICK_PAIRS = 8
BENCHMARK_PAIRS = 40
HEIGHT, WIDTH = 192, 384


def domains() -> dict[str, Domain]:
    """The base domain first, then the sources' domains, by name."""
    return {domain.name: domain for domain in (BASE, *SOURCES)}


def worlds() -> dict[str, Domain]:
    """The benchmarks' worlds by name, the validation benchmark's first."""
    return {world.name: world for world in BENCHMARKS}
