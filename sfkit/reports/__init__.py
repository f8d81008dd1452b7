"""Reports: a parameterised notebook, run without a screen, becomes one HTML file that needs no network."""

from sfkit.reports.conclusion import Conclusion
from sfkit.reports.notebooks import notebook_path
from sfkit.reports.parameters import notebook_parameters, read_parameters
from sfkit.reports.run import ReportError, report

__all__ = [
    "Conclusion",
    "ReportError",
    "notebook_parameters",
    "notebook_path",
    "read_parameters",
    "report",
]
