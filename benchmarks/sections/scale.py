"""Searches on many workers, simulated."""

from __future__ import annotations

from importlib import import_module

from pictures import lines, picture
from processes import shown

DOCUMENT = "benchmarks/README.md"


def section() -> str:
    """The table, a picture, and what to build next."""
    scale = import_module("scale")
    rows = scale.measure()
    curves = {}
    for case in dict.fromkeys(row.case for row in rows):
        of_case = [row for row in rows if row.case == case]
        workers = [row.workers for row in of_case]
        curves[f"{case}: whole evaluations"] = (workers, [100 * row.idle for row in of_case])
        curves[f"{case}: images shared out"] = (workers, [100 * row.idle_shared for row in of_case])
    many = next(row for row in rows if row.workers == 64)
    figure = lines(
        curves,
        title="How much of the workers' time does the generation barrier cost?",
        subtitle=f"{many.case}, 64 workers: {100 * many.idle:.0f} %, with images shared out "
        f"{100 * many.idle_shared:.1f} %",
        x="workers",
        y="idle (%)",
        logarithmic=True,
    )
    idle, rest = f"{100 * many.idle:.1f}", f"{100 * many.idle_shared:.1f}"
    most = next(row for row in reversed(rows) if row.case == many.case)
    verdict = (
        "The rest is above 10 %, so\nwhat to build next is an asynchronous Stage 2 whose results enter by "
        "candidate number, or larger\npopulations where there are many workers."
        if many.idle_shared > 0.1
        else "That is under 10 %:\nno asynchronous variant is needed up to there."
    )
    return f"""## Past this machine: 1 to 256 workers, simulated

`{shown("scale.py")}`: the paper's hours on 4 GPUs, and the bank's seconds an evaluation as measured here;
new subsets a generation as Stage 1 proposes them on the bank, CMA-ES populations of 13 or 14, evaluations
that differ by 5 %. The engines' own schedule shares images out. Broadcast is over 10 Gbit Ethernet, in a
tree.

{picture(figure, "scale", "Idle share of workers against their number")}

{scale.table(rows)}

At 64 workers the barrier idles {idle} % of the paper's search while evaluations stay whole, and {rest} % with
images shared out, which every engine does by itself. {verdict} Task vectors are no obstacle:
{most.memory:.1f} GiB a worker, sent to {most.workers} in {most.broadcast:.0f} s."""
