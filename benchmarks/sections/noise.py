"""Noise over images in a model of the score, and racing."""

from __future__ import annotations

import noise

from sfkit.analysis.tables import markdown_lines

HEAD = """## Does a model gain from knowing how noisy scores are?

`python benchmarks/noise.py` goes on where it was. No network runs: what is taken apart was scored before.
The defaults of `--method bayesian` are what follows from it: one noise for all merges, whole evaluations."""
IMAGES = """### Noise by the spread over images

Stage 1's evaluations in {searches} searches on the bank, {windows} windows each: on all but one a model
learns the score, with noise that is equal everywhere or, by merge, the spread over images of its difference
to the best. Rank correlation of its mean with the scores on the window left out, and how far the merge it
prefers is from the best there, points; means over searches and windows."""
RACING = """### Racing

The bank's table of all subsets, {seeds} seeds: a search scores 8 pairs of 20, which costs 0.4 of an
evaluation, and finishes the 12 others of its best subsets alone. Regret on 20 pairs of what is returned, at
the mean in points, and in brackets in how many seeds it is the optimum, by what the search costs in
evaluations on 20 pairs."""


def section() -> str:
    """Tables of whatever ``benchmarks/noise.py`` has finished.

    Raises:
        SystemExit: that is nothing.
    """
    parts = [part for part in (images(), racing()) if part]
    if not parts:
        raise SystemExit("nothing is finished yet: run python benchmarks/noise.py first")
    return "\n\n".join([HEAD, *parts])


def images() -> str:
    """A row a kind of noise; nothing where none is finished."""
    frame = noise.kept.results("images-")
    if frame.empty:
        return ""
    means = frame.groupby("noise", sort=False)[["correlation", "regret"]].mean()
    rows = [(name, f"{row.correlation:.3f}", f"{row.regret:.2f}") for name, row in means.iterrows()]
    text = IMAGES.format(searches=frame["seed"].nunique(), windows=frame["window"].nunique())
    return f"{text}\n\n{markdown_lines(('noise', 'rank correlation', 'regret'), rows)}"


def racing() -> str:
    """A row a number of subsets that are finished; nothing where none is finished."""
    frame = noise.kept.results("racing-")
    if frame.empty:
        return ""
    costs = sorted(frame["passes"].unique())
    rows = []
    for finished, part in frame.groupby("finished"):
        regrets = [part.loc[part["passes"] == cost, "regret"] for cost in costs]
        cells = [f"{one.mean():.3f} ({(one == 0.0).sum()} of {len(one)})" for one in regrets]
        rows.append((f"best {finished} finished" if finished else "no racing", *cells))
    text = RACING.format(seeds=frame["seed"].nunique())
    return f"{text}\n\n{markdown_lines(('search', *(f'after {cost}' for cost in costs)), rows)}"
