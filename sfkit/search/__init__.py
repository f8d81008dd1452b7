"""Searches: which sources to merge (Stage 1) and how to mix them (Stage 2).

A search proposes recipes and is told outcomes; it never touches a tensor or an image::

    subset = SubsetSearch(pool.sources, pool.blocks, scorer).run().subset
    best = RoutingSearch(subset, pool.blocks, scorer).run()
"""

from typing import TYPE_CHECKING

from sfkit.on_demand import on_demand

if TYPE_CHECKING:
    from sfkit.evaluation.known import Known
    from sfkit.search.averaging import Averaged, averaged_winner
    from sfkit.search.base import Search, SearchState
    from sfkit.search.bayesian_routing import BayesianRoutingSearch
    from sfkit.search.bayesian_settings import BayesianRoutingSettings, BayesianSubsetSettings
    from sfkit.search.bayesian_subset import BayesianSubsetSearch
    from sfkit.search.breeding import SubsetSettings
    from sfkit.search.constraints import Constraints, subset_of, transfer
    from sfkit.search.encoding import Encoding, mean_entropy
    from sfkit.search.journal import Journal, last_run, read_journal
    from sfkit.search.live import LiveSearch
    from sfkit.search.operators import SubsetSpace
    from sfkit.search.records import Candidate, Counts, Generation, SubsetCandidate
    from sfkit.search.routing import RoutingSearch
    from sfkit.search.routing_records import Distribution, RoutingCandidate, RoutingSettings, RoutingState
    from sfkit.search.subset import SubsetSearch, SubsetState
    from sfkit.search.surrogate import Prediction
else:
    __getattr__, __dir__ = on_demand(__name__)

__all__ = [
    "Averaged",
    "BayesianRoutingSearch",
    "BayesianRoutingSettings",
    "BayesianSubsetSearch",
    "BayesianSubsetSettings",
    "Candidate",
    "Constraints",
    "Counts",
    "Distribution",
    "Encoding",
    "Generation",
    "Journal",
    "Known",
    "LiveSearch",
    "Prediction",
    "RoutingCandidate",
    "RoutingSearch",
    "RoutingSettings",
    "RoutingState",
    "Search",
    "SearchState",
    "SubsetCandidate",
    "SubsetSearch",
    "SubsetSettings",
    "SubsetSpace",
    "SubsetState",
    "averaged_winner",
    "last_run",
    "mean_entropy",
    "read_journal",
    "subset_of",
    "transfer",
]
