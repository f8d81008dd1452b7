"""FoundationStereo (Wen et al., "FoundationStereo: Zero-Shot Stereo Matching", CVPR 2025), inference.

images ─► monocular (vit, dense_head) ─┐
       ─► edgenext ─► neck ◄───────────┤
                       │               ▼
                       ▼            context
                  cost_volume          │
                       ▼               │
                  aggregation          │
           (disparity_transformer)     │
                       ▼               ▼
                     lookup ──────► update ──► upsampling ──► disparity

Our own code, after the paper. Weights are not part of sfkit: NVIDIA publishes them under its own terms.
"""

from sfkit.architectures.foundation_stereo.builder import foundation_stereo
from sfkit.architectures.foundation_stereo.hierarchical import hierarchical_disparity
from sfkit.architectures.foundation_stereo.network import FoundationStereo, RefinementTrace
from sfkit.architectures.foundation_stereo.options import options_from_config
