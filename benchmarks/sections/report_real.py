"""The full report on real AnyNet checkpoints, two of them harmful: pairs of three data sets guide."""

from __future__ import annotations

from pathlib import Path

from full_report import make, markdown
from real_pairs import SIZE, gather

from sfkit.baselines import baselines

ROOT = Path(__file__).parents[2]
POOL = "tests/pools/anynet_real_six.toml"
LEFT_OUT = ("adamerging", "adamerging_blocks", "exhaustive")


def section() -> str:
    """Make the report, and show its summary and its tables."""
    guides, unseen = gather(ROOT / "runs" / "results" / "real_pairs")
    values = {
        "pool": str(ROOT / POOL),
        "benchmark": "pairs",
        "benchmark_root": str(guides),
        "benchmark_pairs": None,
        "metric": "bad-1.0",
        "report_on": [{"name": "pairs", "root": str(unseen), "metric": "bad-1.0"}],
        "population": 16,
        "generations": 6,
        "evaluations": 30,
        "seeds": 3,
        "methods": [name for name in baselines() if name not in LEFT_OUT],
    }
    done = make(ROOT / "runs" / "results" / "report_real", values)
    height, width = SIZE
    return f"""## The full report on real AnyNet checkpoints

`sfkit report` with the pool `{POOL}`, six sources of which two harm (`half_size`, `own_images`); M = 16,
T = 6, 30 evaluations of Stage 2, 3 seeds; AdaMerging is left out to keep it short. Pairs of three data sets
guide (ETH3D's playground, Middlebury's Cones and Reindeer). Six images of four others test, which no source
was tuned on: Middlebury's Motorcycle, three frames of SceneFlow (the base's training set), one each of
InStereo2K and TartanAir. Of images larger than {width} x {height} pixels that middle is taken. `all-valid`
and bad-1.0 everywhere. It took {done.minutes:.0f} minutes with nothing in the store. What it says first:

{done.summary()}

All methods; `*` marks what guided them, `†` a row that chose by the mean of all:

{markdown(done.table("main", "method"))}

Against the last row on what nobody saw, in points; `low` and `high` are the ends of the 95 % interval, over
images and, where a method draws, its seeds:

{markdown(done.table("differences", "method"))}

Single sources:

{markdown(done.table("sources", "benchmark"))}

Which sources the seeds of both stages chose:

{markdown(done.table("selection", "source"))}

Cosines of the task vectors, by which the pool has fewer directions than sources, and how far each went, in
percent of the base's norm:

{markdown(done.table("cosines", "source"))}

{markdown(done.table("geometry", "block"), digits=1)}

What each method took, all its runs together:

{markdown(done.table("cost", "method"), digits=1)}

Stages and scales (seed 0), then what guides:

{markdown(done.table("stages", "variant"))}

{markdown(done.table("guides", "fitness"))}"""
