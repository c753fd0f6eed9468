"""Robust control benchmark of a flexible manipulator: any controller FMU, evaluated in closed loop.

>>> from orchestrator import Benchmark, Controller
>>> evaluation = Benchmark("quick").evaluate(Controller("my_controller.fmu"))  # doctest: +SKIP
>>> evaluation.cost, evaluation.requirements["A2"].passed  # doctest: +SKIP
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .version import __version__

if TYPE_CHECKING:
    from controller_fmu import controller_from_mlp, controller_from_state_space

    from .api.benchmark import Benchmark
    from .api.linear import LinearLoop, LinearModel
    from .api.simulation import Simulation
    from .benchmark.variation import Variation
    from .documents.comparison import compare
    from .documents.evaluation import Evaluation
    from .documents.reliability import Reliability
    from .documents.robustness import Robustness
    from .documents.spread import Spread
    from .documents.sweep import Sweep
    from .documents.tuning import Tuning
    from .documents.verification import Verification
    from .errors import BenchmarkError, Crash, EnvironmentFault, FmuError, InputError
    from .pairing.controller import Controller

__all__ = [
    "Benchmark",
    "BenchmarkError",
    "Controller",
    "Crash",
    "EnvironmentFault",
    "Evaluation",
    "FmuError",
    "InputError",
    "LinearLoop",
    "LinearModel",
    "Reliability",
    "Robustness",
    "Simulation",
    "Spread",
    "Sweep",
    "Tuning",
    "Variation",
    "Verification",
    "__version__",
    "compare",
    "controller_from_mlp",
    "controller_from_state_space",
]

_HOMES = {
    "Benchmark": ".api.benchmark",
    "Controller": ".pairing.controller",
    "Evaluation": ".documents.evaluation",
    "LinearLoop": ".api.linear",
    "LinearModel": ".api.linear",
    "Reliability": ".documents.reliability",
    "Robustness": ".documents.robustness",
    "Simulation": ".api.simulation",
    "Spread": ".documents.spread",
    "Sweep": ".documents.sweep",
    "Tuning": ".documents.tuning",
    "Variation": ".benchmark.variation",
    "Verification": ".documents.verification",
    "compare": ".documents.comparison",
    "controller_from_mlp": "controller_fmu",
    "controller_from_state_space": "controller_fmu",
}
"""Modules that define public names: imported when first used, so that importing the package is free; the other names
are errors."""


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES.get(name, ".errors"), __name__), name)


def __dir__() -> list[str]:
    return sorted(__all__)
