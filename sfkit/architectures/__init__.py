"""Architectures: the registry, and the networks that come with sfkit."""

from typing import TYPE_CHECKING

from sfkit.on_demand import on_demand

if TYPE_CHECKING:
    from sfkit.architectures import adapters
    from sfkit.architectures.anynet import AnyNet
    from sfkit.architectures.foundation_stereo import FoundationStereo
    from sfkit.architectures.inputs import InputConvention, PadSides, PreparedPair, Window
    from sfkit.architectures.nmrf import NMRF
    from sfkit.architectures.registry import Architecture, architecture, architectures, register_architecture
else:
    __getattr__, __dir__ = on_demand(__name__)
