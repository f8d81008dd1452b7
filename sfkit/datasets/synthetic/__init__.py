"""Small synthetic stereo worlds with exact disparity and occlusion."""

from sfkit.datasets.synthetic.domains import Domain, domains, worlds
from sfkit.datasets.synthetic.pairs import SyntheticPair, synthetic_pair
