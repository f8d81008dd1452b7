"""AnyNet: "Anytime Stereo Image Depth Estimation on Mobile Devices" (Wang et al., ICRA 2019)."""

from sfkit.architectures.anynet.aggregation import Route
from sfkit.architectures.anynet.network import AnyNet, SlimAnyNet, StageTrace
from sfkit.architectures.anynet.wide import WideAnyNet
