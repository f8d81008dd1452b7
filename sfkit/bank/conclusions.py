"""Plain sentences about the bank's scores, each drawn from the numbers it states."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from sfkit.bank.scores import UNIFORM, BankScores
from sfkit.datasets.synthetic.domains import BASE


def conclusions(scores: BankScores) -> Iterator[str]:
    """What the tables say: the base, the sources that help and that harm, uniform merging."""
    unseen = scores.unseen
    sources = unseen.drop([BASE.name, UNIFORM]).sort_values()
    yield _base(scores)
    yield _own_domains(scores)
    yield _help_and_harm(sources, unseen[BASE.name])
    yield _best_elsewhere(scores)
    yield _uniform(sources, unseen)
    yield _range(scores.benchmarks)


def _base(scores: BankScores) -> str:
    own = scores.trainings[BASE.name]["own_domain"]
    share = own["base"]["epe"] / own["constant_guess"]["epe"]
    return (
        f"On its own domain the base is off by {own['base']['epe']:.2f} px on average, {100 * share:.0f} % "
        f"of what the best constant guess costs ({own['constant_guess']['epe']:.2f} px), with "
        f"{own['base']['bad3']:.1f} % bad pixels."
    )


def _own_domains(scores: BankScores) -> str:
    gains = {
        name: 100 * (1 - record["own_domain"]["source"]["epe"] / record["own_domain"]["base"]["epe"])
        for name, record in scores.trainings.items()
        if name != BASE.name
    }
    low, high = min(gains, key=gains.__getitem__), max(gains, key=gains.__getitem__)
    return (
        f"Every source beats the base on its own domain: its EPE is lower by {gains[low]:.0f} % ({low}) to "
        f"{gains[high]:.0f} % ({high})."
        if gains[low] > 0
        else f"Not every source beats the base on its own domain: {low} does not ({gains[low]:.0f} %)."
    )


def _help_and_harm(sources: pd.Series, base: float) -> str:
    helping, harming = sources[sources < base], sources[sources >= base]
    rest = f"{len(harming)} harm: {_listed(harming)}" if len(harming) else "none harms"
    return (
        f"On the mean of the unseen benchmarks the base has {base:.1f} % bad pixels. Alone, {len(helping)} "
        f"of the {len(sources)} sources help: {_listed(helping)}; {rest}."
    )


def _best_elsewhere(scores: BankScores) -> str:
    winners = scores.domains.drop(index=UNIFORM).idxmin()
    best = {str(domain): str(network) for domain, network in winners.items()}
    own = [domain for domain, network in best.items() if network == domain]
    others = [f"{domain} ({network})" for domain, network in best.items() if network != domain]
    rest = f"; elsewhere another one is better: {', '.join(others)}" if others else ""
    return f"By bad-3.0, {len(own)} of {len(best)} domains are served best by their own network{rest}."


def _uniform(sources: pd.Series, unseen: pd.Series) -> str:
    uniform, base = unseen[UNIFORM], unseen[BASE.name]
    better = int((sources > uniform).sum())
    against_base = "below" if uniform < base else "not below"
    verdict = "suffers" if better < len(sources) / 2 or uniform >= base else "does not suffer"
    return (
        f"Merging all {len(sources)} sources equally gives {uniform:.1f} %, {against_base} the base's "
        f"{base:.1f} %; it beats {better} of the {len(sources)} single sources, whose mean is "
        f"{sources.mean():.1f} % and whose best, {sources.index[0]}, has {sources.iloc[0]:.1f} %. "
        f"Uniform merging {verdict} here."
    )


def _range(benchmarks: pd.DataFrame) -> str:
    networks = benchmarks.drop(index=UNIFORM)
    return (
        f"Over the {len(networks)} networks and {networks.shape[1]} benchmarks, scores run from "
        f"{networks.min().min():.1f} % to {networks.max().max():.1f} %."
    )


def _listed(scores: pd.Series) -> str:
    return ", ".join(f"{name} ({score:.1f} %)" for name, score in scores.items()) or "none"
