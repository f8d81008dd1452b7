"""A network out of sfkit: ONNX, torch.export, TorchScript, or the checkpoint its training code reads."""

from typing import TYPE_CHECKING

from sfkit.on_demand import on_demand

if TYPE_CHECKING:
    from sfkit.exporting.export import Exported, export_network
    from sfkit.exporting.forms import Form
else:
    __getattr__, __dir__ = on_demand(__name__)
