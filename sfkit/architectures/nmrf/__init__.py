"""NMRF: neural Markov random field stereo (CVPR 2024), with a residual and a Swin-T encoder."""

from sfkit.architectures.nmrf.builders import Normalisation, nmrf_res, nmrf_swint
from sfkit.architectures.nmrf.network import NMRF, Coarse, NMRFOutput
