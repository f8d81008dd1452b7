"""Reports: a parameterised notebook, run without a screen, becomes one HTML file that needs no network."""

from typing import TYPE_CHECKING

from sfkit.on_demand import on_demand

if TYPE_CHECKING:
    from sfkit.reports.conclusion import Conclusion
    from sfkit.reports.notebooks import notebook_path
    from sfkit.reports.parameters import notebook_parameters, read_parameters
    from sfkit.reports.run import ReportError, report
else:  # a notebook that states a conclusion needs none of papermill and nbconvert
    __getattr__, __dir__ = on_demand(__name__)
