"""A recipe for people to read."""

from __future__ import annotations

import pandas as pd

from sfkit.merging.recipe import Recipe


def recipe_table(recipe: Recipe) -> pd.DataFrame:
    """A row a block: the weight of each source (0 to 1, of the base where nothing is mixed) and the scale."""
    rows = [
        {**dict(zip(recipe.sources, weights, strict=True)), "scale": scale}
        for weights, scale in zip(recipe.weights, recipe.scales, strict=True)
    ]
    return pd.DataFrame(rows, index=pd.Index(recipe.blocks, name="block"))
