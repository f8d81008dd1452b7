"""What the report notebook needs to know of a factory."""

from __future__ import annotations

from typing import Any

from sfkit.errors import InputError
from sfkit.factory.file import Factory

# Arguments of sfkit.open_benchmark -> parameters of notebooks/report.ipynb.
PARAMETERS = {
    "name": "benchmark",
    "root": "benchmark_root",
    "pairs": "benchmark_pairs",
    "protocol": "protocol",
    "metric": "metric",
}


def report_values(factory: Factory) -> dict[str, Any]:
    """Parameters of the report on a factory's pool: its benchmarks and its budgets.

    Raises:
        InputError: the report cannot be guided as the factory is: by several benchmarks, by arguments it has
            no parameter for, or by Stage 1 alone.
    """
    count, plan = len(factory.validation), factory.plan
    if count > 1 or plan.stage2 is None or plan.method != "paper":
        routed = "left out" if plan.stage2 is None else "included"
        raise InputError(
            f"{factory.file}: found {count} validation benchmarks, method {plan.method}, Stage 2 {routed}; "
            "the report takes one, the paper's method and both stages, expected those; leave out --report"
        )
    guide, tests = factory.given[0], factory.given[1:]
    for key in guide:
        if key not in PARAMETERS:
            raise InputError(
                f"{factory.file}: validation has the argument {key!r}, which the report has no parameter "
                f"for, expected {', '.join(PARAMETERS)}"
            )
    return {
        **{PARAMETERS[key]: value for key, value in guide.items()},
        "pool": factory.out / "pool.toml",
        "benchmark_pairs": guide.get("pairs"),
        "report_on": [dict(test) for test in tests],
        "population": plan.stage1.population,
        "generations": plan.stage1.generations,
        "evaluations": plan.stage2.evaluations,
        "resamples": plan.resamples,
        "seed": plan.stage1.seed,
    }
