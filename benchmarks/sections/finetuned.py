"""Sources fine-tuned from the real AnyNet base on real frames, in one pool with the real sources."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
from processes import RESULTS
from processes import sfkit as command
from real_pairs import FRAMES, POOL, data, frames, gather
from tabulated import markdown

import sfkit
from sfkit.checkpoints.spec import read_pool_spec
from sfkit.datasets import memory_benchmark
from sfkit.evaluation import score_recipes
from sfkit.files import write_text
from sfkit.merging import Pool
from sfkit.outside import toml_value
from sfkit.training.places import training_folder

ROOT = Path(__file__).parents[2]
OUT = RESULTS / "finetuned"
STEPS, BATCH, CROP = 200, 2, "128x256"
POPULATION, GENERATIONS, EVALUATIONS = 8, 4, 20


def tuned(name: str) -> Path:
    """The source of one data set's frames; one that is there is not trained again."""
    out = OUT / f"{name}.safetensors"
    if not out.exists():
        words = f"-a anynet --all --epochs 1000 --max-steps {STEPS} --batch {BATCH} --crop {CROP}".split()
        root = data() / "sources" / FRAMES[name]
        base = data() / "anynet" / "base_sceneflow.tar"
        command("finetune", str(base), name, "--root", str(root), "--out", str(out), *words)
    return out


def pool_file(tuned_files: list[Path]) -> Path:
    """The real pool and the sources that were trained here, which lie elsewhere: every path is absolute."""
    spec = read_pool_spec(POOL)
    named = {**{source.name: source.path for source in spec.sources}, **{f.stem: f for f in tuned_files}}
    lines = [
        f'name = "{spec.name}"\narchitecture = "{spec.architecture}"\nroot = "/"',
        f"[base]\nfile = {toml_value(str(spec.base.path))}",
        *(f"[sources.{name}]\nfile = {toml_value(str(path.resolve()))}" for name, path in named.items()),
    ]
    return write_text(OUT / "pool.toml", "\n\n".join(lines) + "\n")


def at_home(pool: Pool) -> pd.DataFrame:
    """What each training took, and end-point error on its own frames, of the base and of the source."""
    rows = {}
    for name in FRAMES:
        own = memory_benchmark(name, frames(name), metric="epe")
        scores = score_recipes(pool, {"base": pool.base_recipe(), "own": pool.equal(name)}, [own])
        base, source = scores.set_index("network")["score"][["base", "own"]]
        said = json.loads((training_folder(OUT / f"{name}.safetensors") / "training.json").read_text())
        rows[name] = [len(own), said["steps"], said["cpu_seconds"], said["loss"], base, source]
    columns = ["frames", "steps", "CPU seconds", "last loss", "base EPE", "own EPE"]
    return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("trained on")


def measure() -> tuple[Pool, list[str], pd.DataFrame]:
    """Train, open, search: the pool, the subset of Stage 1, and every network's kinship and score."""
    OUT.mkdir(parents=True, exist_ok=True)
    guides, _ = gather(RESULTS / "real_pairs")
    path = pool_file([tuned(name) for name in FRAMES])
    pool = sfkit.open_pool(path)
    sizes = f"--population {POPULATION} --generations {GENERATIONS} --evaluations {EVALUATIONS}".split()
    where = ["--benchmark", "pairs", "--root", str(guides), "--metric", "bad-1.0"]
    command("search", str(path), *where, *sizes, "--out", str(OUT / "search"))
    result = json.loads((OUT / "search" / "result.json").read_text(encoding="utf-8"))
    recipes = {name: pool.equal(name) for name in pool.names}
    recipes = {"base": pool.base_recipe(), **recipes, "uniform": pool.uniform()}
    recipes["found"] = sfkit.read_recipe(OUT / "search" / "recipe.json")
    benchmark = sfkit.open_benchmark("pairs", guides, metric="bad-1.0")
    scores = score_recipes(pool, recipes, [benchmark]).set_index("network")["score"]
    kin = pool.summary()["cosine to base"]
    table = pd.DataFrame({"cosine to the base": kin.reindex(scores.index), "bad-1.0": scores})
    return pool, result["subset"], table


def section() -> str:
    """What each of them said."""
    pool, subset, table = measure()
    doubts = "; ".join(pool.warnings) or "none"
    return f"""## Sources fine-tuned here, from a real base on real frames

`sfkit finetune base_sceneflow.tar NAME --all --max-steps {STEPS} --batch {BATCH} --crop {CROP}` on the few
frames of three data sets that are at hand, then the four real AnyNet sources and these three in one pool,
searched with M = {POPULATION}, T = {GENERATIONS} and {EVALUATIONS} evaluations, guided by bad-1.0 on three
pairs (ETH3D, Middlebury 2003 and 2005, cut to 256 x 512). A test of the road: of so few frames no quality is
claimed.

{markdown(at_home(pool))}

Doubts on opening the pool (a source that does not look like a fine-tune of the base is named): {doubts}.
Stage 1 chose {", ".join(subset)}.

{markdown(table.rename_axis("network"))}"""
