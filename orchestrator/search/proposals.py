"""Which candidates a tuning tries next: a sampler of Optuna, asked for a generation at a time."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import EnvironmentFault
from .candidates import Range

# Imports inside functions: Optuna is optional.

SAMPLERS = ("cmaes", "tpe", "random")
"""CMA-ES, the tree-structured Parzen estimator, and points at random."""

GENERATION = 14
"""Candidates that are tried side by side before the sampler learns of them: the same number on every machine, so that
the answer does not depend on its cores."""

STUDY = "study.log"
"""Optuna's own record, for its dashboard and plots."""


class Proposals:
    """A study of Optuna over ``vary`` that begins at ``start``; its ``record`` is a file, if wanted.

    The same objectives lead to the same candidates: an interrupted study is repeated with the stored ones.
    """

    def __init__(
        self, vary: Mapping[str, Range], start: Mapping[str, float], sampler: str, seed: int, record: Path | None
    ) -> None:
        optuna = _optuna()
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        samplers = optuna.samplers
        chosen = {
            "cmaes": lambda: samplers.CmaEsSampler(x0=dict(start), seed=seed, popsize=GENERATION),
            "tpe": lambda: samplers.TPESampler(seed=seed, multivariate=True),
            "random": lambda: samplers.RandomSampler(seed=seed),
        }
        storage = None
        if record is not None:
            record.unlink(missing_ok=True)  # of the search that this one repeats
            journal = optuna.storages.journal
            storage = optuna.storages.JournalStorage(journal.JournalFileBackend(str(record)))
        with warnings.catch_warnings():
            # x0 is to go with Optuna 6, which pyproject.toml excludes: nothing else makes a search begin at its start.
            warnings.simplefilter("ignore", FutureWarning)
            self._study = optuna.create_study(storage=storage, sampler=chosen[sampler]())
        self._study.enqueue_trial(dict(start))
        self._space = {
            name: optuna.distributions.FloatDistribution(span.low, span.high, log=span.log)
            for name, span in vary.items()
        }
        self._vary, self._first = vary, True
        self._asked: list[Any] = []

    def ask(self, count: int) -> list[dict[str, float]]:
        """The next candidates, at most ``count``; the first one is the start alone."""
        size = 1 if self._first else min(count, GENERATION)
        self._first = False
        self._asked = [self._study.ask(self._space) for _ in range(size)]
        return [{name: self._vary[name].rounded(trial.params[name]) for name in self._vary} for trial in self._asked]

    def tell(self, objectives: Sequence[float]) -> None:
        """The objectives of the candidates that were asked for last."""
        for trial, value in zip(self._asked, objectives, strict=True):
            self._study.tell(trial, value)

    def importance(self) -> dict[str, float]:
        """The share of each parameter in how the objective varies among the better candidates (PED-ANOVA)."""
        from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances

        values = {trial.value for trial in self._study.trials}
        if len(values) < 2 or len(self._vary) < 2:
            return {}
        shares = get_param_importances(self._study, evaluator=PedAnovaImportanceEvaluator())
        return {name: float(shares.get(name, 0.0)) for name in self._vary}


def _optuna() -> Any:
    try:
        import cmaes  # noqa: F401  # the sampler imports it when it is first asked
        import optuna
    except ImportError as problem:
        message = f"Tuning needs Optuna and cmaes ({problem}): pip install optuna cmaes"
        raise EnvironmentFault(message, "no-optuna") from problem
    return optuna
