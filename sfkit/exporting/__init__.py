"""A network out of sfkit: ONNX, torch.export, TorchScript, or the checkpoint its training code reads."""

from sfkit.exporting.export import Exported, export_network
from sfkit.exporting.forms import Form
