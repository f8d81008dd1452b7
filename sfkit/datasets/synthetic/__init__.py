"""Small synthetic stereo worlds with exact disparity and occlusion."""

from typing import TYPE_CHECKING

from sfkit.datasets.synthetic.domains import Domain, domains, worlds
from sfkit.on_demand import on_demand

# The worlds have names for whoever mistypes one; what renders them needs arrays.
if TYPE_CHECKING:
    from sfkit.datasets.synthetic.pairs import SyntheticPair, synthetic_pair
else:
    __getattr__, __dir__ = on_demand(__name__)
