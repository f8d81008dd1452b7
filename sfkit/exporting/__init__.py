"""A network out of sfkit: ONNX, torch.export, TorchScript, or the checkpoint its training code reads."""

from sfkit.exporting.export import Exported, Form, export_network
