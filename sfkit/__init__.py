"""sfkit: merge stereo-matching networks, after the paper StereoFactory.

Open a pool, search which sources to merge (Stage 1) and how (Stage 2), write one network:

    import sfkit

    pool = sfkit.open_pool("pool.toml")
    validation = sfkit.open_benchmark("eth3d", "~/ETH3D")
    scorer = sfkit.Evaluator(pool, validation, store=sfkit.EvaluationStore("runs/evaluations.sqlite"))
    which = sfkit.SubsetSearch(pool.names, pool.blocks, scorer).run()
    how = sfkit.RoutingSearch(which.subset, pool.blocks, scorer).run()
    sfkit.save_merged(pool, how.recipe, "runs/merged.safetensors")
"""

from typing import TYPE_CHECKING

from sfkit.on_demand import on_demand

if TYPE_CHECKING:
    from sfkit import baselines
    from sfkit.architectures import InputConvention, PadSides, register_architecture
    from sfkit.architectures.code import trust_code
    from sfkit.bank import open_source_data
    from sfkit.checkpoints import FileForm, read_checkpoint
    from sfkit.datasets.benchmark import Benchmark, open_benchmark, open_benchmarks
    from sfkit.datasets.calibration import Calibration, read_calibration
    from sfkit.datasets.check import check_data
    from sfkit.datasets.metric import Metric, register_metric
    from sfkit.errors import InputError, SfkitError, SfkitWarning, StoreError
    from sfkit.evaluation import (
        CombinedScorer,
        Compute,
        Estimate,
        EvaluationStore,
        Evaluator,
        Outcome,
        estimate,
        pivot,
        score_recipes,
        validation_scorer,
    )
    from sfkit.evaluation.stereo_model import Disparity, StereoModel, load
    from sfkit.exporting import export_network
    from sfkit.merging import LiveModel, Pool, Recipe, open_pool, routed
    from sfkit.merging.network import load_network
    from sfkit.merging.origin import read_origin, read_recipe
    from sfkit.merging.prepare import prepare, prepared_for
    from sfkit.merging.saving import save_merged
    from sfkit.merging.steps import Drop, Elect, FisherMean, Mean, Trim
    from sfkit.search import (
        BayesianRoutingSearch,
        BayesianRoutingSettings,
        BayesianSubsetSearch,
        BayesianSubsetSettings,
        Constraints,
        Journal,
        LiveSearch,
        RoutingSearch,
        RoutingSettings,
        SubsetSearch,
        SubsetSettings,
        transfer,
    )
    from sfkit.training import Augmentation, TrainingSettings
    from sfkit.training.finetune import finetune

    __version__: str
else:
    _named, __dir__ = on_demand(__name__)

    def __getattr__(name: str) -> object:
        if name != "__version__":
            return _named(name)
        from importlib.metadata import version

        return version("sfkit")


__all__ = [
    "Augmentation",
    "BayesianRoutingSearch",
    "BayesianRoutingSettings",
    "BayesianSubsetSearch",
    "BayesianSubsetSettings",
    "Benchmark",
    "Calibration",
    "CombinedScorer",
    "Compute",
    "Constraints",
    "Disparity",
    "Drop",
    "Elect",
    "Estimate",
    "EvaluationStore",
    "Evaluator",
    "FileForm",
    "FisherMean",
    "InputConvention",
    "InputError",
    "Journal",
    "LiveModel",
    "LiveSearch",
    "Mean",
    "Metric",
    "Outcome",
    "PadSides",
    "Pool",
    "Recipe",
    "RoutingSearch",
    "RoutingSettings",
    "SfkitError",
    "SfkitWarning",
    "StereoModel",
    "StoreError",
    "SubsetSearch",
    "SubsetSettings",
    "TrainingSettings",
    "Trim",
    "baselines",
    "check_data",
    "estimate",
    "export_network",
    "finetune",
    "load",
    "load_network",
    "open_benchmark",
    "open_benchmarks",
    "open_pool",
    "open_source_data",
    "pivot",
    "prepare",
    "prepared_for",
    "read_calibration",
    "read_checkpoint",
    "read_origin",
    "read_recipe",
    "register_architecture",
    "register_metric",
    "routed",
    "save_merged",
    "score_recipes",
    "transfer",
    "trust_code",
    "validation_scorer",
]
