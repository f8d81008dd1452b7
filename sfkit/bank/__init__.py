"""The embedded bank: a base network and 11 sources, really trained, and four benchmarks to merge for.

``bank-slim`` has the same domains and names, of another architecture: what one pool found can be tried there.
``bank-sharp`` has domains of the same names that nobody softened, stronger networks and a joint one.

Everything comes from seeds: ``sfkit bank build`` makes it again (see :mod:`sfkit.bank.building`).
"""

from typing import TYPE_CHECKING

from sfkit.on_demand import on_demand

if TYPE_CHECKING:
    from sfkit.bank.building import build
    from sfkit.bank.plan import BANK, BANKS, bank_plan, banks
    from sfkit.bank.rendered import benchmark, benchmarks, held_out
    from sfkit.bank.sharp import JOINT
    from sfkit.bank.shipped import (
        joint_path,
        joint_training,
        open_source_data,
        pool_path,
        training_seconds,
        trainings,
        worlds,
    )
    from sfkit.datasets.synthetic.domains import VALIDATION, domains
else:
    __getattr__, __dir__ = on_demand(__name__)
