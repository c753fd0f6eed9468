"""The benchmark: a protocol, a seed, a plant and the conditions controllers are tried under."""

from __future__ import annotations

import fnmatch
import functools
import logging
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from pathlib import Path

from plant_fmu.flexible_manipulator.parameters import NOMINAL

from ..benchmark import cases as case_list
from ..benchmark import protocol as protocols
from ..benchmark.case import Case
from ..benchmark.metrics import judge, named
from ..benchmark.nominal import check_changes
from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult, RunTiming
from ..benchmark.variation import Variation, vary
from ..conformance.finding import Finding
from ..errors import InputError
from ..execution import cluster, pool, store
from ..execution.job import Limits
from ..loop.sampling import controller_sample_time
from ..reporting.files import prepare_folder
from . import campaign, checking, document, stored
from .campaign import Bench, CaseRun
from .controller import Controller
from .evaluation import Evaluation
from .plant import AUTO, NATIVE, PYTHON, Plant, choose
from .recorder import record_shown
from .simulation import Simulation

logger = logging.getLogger(__name__)

OnResult = Callable[[CaseResult, int, int], None]
"""Is told each result as it comes, how many there are, and how many there will be."""


def available_cores() -> int:
    """Number of processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@dataclass(frozen=True)
class Benchmark:
    """The benchmark under fixed conditions; every method may be called from any thread, script or notebook.

    Parameters
    ----------
    protocol : str or path
        ``"paper"``, ``"quick"``, or a protocol file of your own (``.toml``).
    seed : int
        Base seed of random systems, disturbances and noise.
    workers : int, optional
        Processes at a time; all cores by default.
    plant_parameters : mapping
        Changed nominal parameters of the manipulator by FMI name, SI units: ``{"k_high[2]": 0.5e6}``.
    plant : str or path
        ``"native"``, the manipulator in C; ``"python"``, the same by pythonfmu; ``"auto"``, the first where there is a
        compiler whose code gives the bits of the second, else the second; or an FMU of your own.
    timeout : float
        Wall time [s] that a simulation of 26 s may take; shorter ones get their share, all some seconds to start.
    memory_limit : float
        Memory [bytes] that a simulation's process may use.
    sandbox : bool
        Whether FMUs run without network and with read-only files (needs bubblewrap).
    scheduler : str, optional
        Address of a Dask scheduler, ``"tcp://host:port"``, to evaluate on its cluster.

    Raises
    ------
    InputError
        If the protocol or a plant parameter does not exist, or a number makes no sense.
    """

    protocol: str | Path = "paper"
    seed: int = 0
    workers: int | None = None
    plant_parameters: Mapping[str, float] = field(default_factory=dict)
    plant: str | Path = AUTO
    timeout: float = 60.0
    memory_limit: float = 2e9
    sandbox: bool = False
    scheduler: str | None = None

    def __post_init__(self) -> None:
        if self.seed < 0 or (self.workers is not None and self.workers < 1):
            raise InputError("The seed must not be negative, and at least one worker is needed.", "bad-number")
        for name in ("timeout", "memory_limit"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise InputError(f"The {name} must be positive and finite, not {value}.", "bad-number", name, value)
        check_changes(self.plant_parameters, self.rules.uncertainty)

    @functools.cached_property
    def rules(self) -> Protocol:
        """The protocol's contents."""
        return protocols.load(self.protocol)

    @functools.cached_property
    def manipulator(self) -> Plant:
        """The manipulator's FMU, see ``plant``; it is built on first use."""
        return choose(self.plant)

    @functools.cached_property
    def nominal(self) -> dict[str, float]:
        """The plant's nominal parameters by FMI name, SI units."""
        own = NOMINAL if self.plant in (AUTO, PYTHON, NATIVE) else self.manipulator.nominal
        return {**own, **self.plant_parameters}

    @functools.cached_property
    def cases(self) -> tuple[Case, ...]:
        """All cases of the protocol, in its order."""
        return case_list.cases(self.rules, self.nominal, self.seed)

    def case(self, id: str) -> Case:
        """The case called ``id``, such as ``"c07.compliant.gain_1"``, also with a system the protocol does not run.

        Raises :class:`InputError` if there is none.
        """
        return case_list.case_named(self.rules, self.nominal, self.seed, id)

    def case_at(
        self,
        q_a: tuple[float, float],
        system: str = "nominal",
        test: str = "disturbance",
        variation: Variation | None = None,
    ) -> Case:
        """The case of a pose ``q_a`` [rad], anywhere in the workspace, a system and a test, varied if wanted."""
        wanted = self.rules.test(test)
        pose = case_list.configuration(self.rules, *q_a)
        member = case_list.system(self.rules, self.nominal, self.seed, pose.index, system, wanted)
        found = case_list.case(self.rules, pose, member, wanted, self.seed)
        return found if variation is None else self.varied(found, variation)

    def varied(self, case: Case, variation: Variation) -> Case:
        """``case`` with single disturbances and imperfections set or switched off."""
        return replace(case, scenario=vary(case.scenario, self.rules, variation))

    def check(self, controller: Controller | None = None) -> tuple[Finding, ...]:
        """What can be said of a controller before any evaluation: what it is, how it is bound, how it behaves.

        Whatever is wrong with it is a finding, not an exception.
        """
        return tuple(self.iter_check(controller or Controller()))

    def iter_check(self, controller: Controller) -> Iterator[Finding]:
        """The findings of :meth:`check` as they come."""
        return checking.findings(controller, lambda: self._bench(controller), self.rules)

    def evaluate(
        self,
        controller: Controller | None = None,
        *,
        only: Sequence[str] | str = (),
        folder: str | Path | None = None,
        recordings: bool = True,
        keep_going: bool = False,
        force: bool = False,
        on_result: OnResult | None = None,
    ) -> Evaluation:
        """Run the protocol.

        Parameters
        ----------
        controller : Controller, optional
            By default the paper's PID.
        only : str or sequence of str
            Patterns with ``*`` and ``?``; only cases whose name matches one are run.
        folder : path, optional
            Where finished cases are stored as they come and found again, so that an interrupted evaluation goes on;
            the evaluation is saved there, too. By default nothing is written.
        recordings : bool
            Whether the cases that a report shows are simulated once more and recorded.
        keep_going : bool
            Whether to run on after three failures of one kind, and to run again what failed in an earlier run.
        force : bool
            Whether to run again what an earlier run has finished.
        on_result : callable, optional
            ``on_result(result, done, total)`` is called for each case.

        Returns
        -------
        Evaluation

        Raises
        ------
        InputError
            If controller, patterns or folder cannot be used.
        FmuError
            If the controller refuses its first sample.
        EnvironmentFault
            If this machine or the cluster fails; what is finished is kept in ``folder``.
        """
        controller = controller or Controller()
        bench = self._bench(controller)
        sample_time = controller_sample_time(bench.controller, self.rules.sample_time, controller.given_sample_time)
        cases = _chosen(case_list.cases(self.rules, self.nominal, self.seed, sample_time.value), only)
        target = Path(folder) if folder is not None else None
        if target is not None:
            prepare_folder(target)
        start, begin = datetime.now(timezone.utc), time.perf_counter()
        with store.opened(target) as known:
            rehearsal = campaign.rehearse(cases[0], bench)
            runs = self._run(cases, bench, known, rehearsal.failure, keep_going, force, on_result)
            timing = RunTiming(
                start.isoformat(timespec="seconds"),
                time.perf_counter() - begin,
                self._workers,
                sum(run.result.time for run in runs),
                sum(run.wall_time for run in runs),
            )
            results = document.results(
                self.rules,
                str(self.protocol) if str(self.protocol) != self.rules.name else "",
                self.seed,
                bench,
                controller,
                document.plant_record(self.manipulator, self.plant_parameters),
                sample_time.value,
                rehearsal.timing,
                runs,
                timing,
            )
            evaluation = Evaluation(results)
            if target is not None:
                evaluation.save(target)  # before the recordings: whatever happens now, the results are there
            if recordings:
                shown = record_shown(self.rules, self.nominal, self.seed, runs, results.scorecard, bench, self._workers)
                evaluation = replace(evaluation, recordings=shown)
                if target is not None:
                    evaluation.save(target)
        return evaluation

    def simulate(
        self, controller: Controller | None = None, case: Case | str = "c07.compliant.disturbance"
    ) -> Simulation:
        """Simulate one case, by name or from :meth:`case`, :meth:`case_at`, :meth:`varied`.

        Raises :class:`InputError` for a case that does not exist, :class:`FmuError` if an FMU fails before the first
        sample, :class:`Crash` if the simulation's process ends before the simulation.
        """
        controller = controller or Controller()
        bench = self._bench(controller)
        wanted = self.case(case) if isinstance(case, str) else case
        sample_time = controller_sample_time(
            bench.controller, wanted.scenario.sample_time, controller.given_sample_time
        )
        scenario = replace(wanted.scenario, sample_time=sample_time.value)
        wanted = replace(wanted, scenario=scenario)
        trajectory = campaign.simulate(bench, scenario)
        result = None
        if self._is_of_protocol(wanted):
            result = named(wanted, judge(self.rules, wanted, trajectory))
        return Simulation(wanted, bench.controller.name, trajectory, result)

    def _is_of_protocol(self, case: Case) -> bool:
        """Whether the case is as the protocol has it, but for the controller's sample time."""
        plain = case_list.case(self.rules, case.configuration, case.system, case.test, self.seed)
        return replace(plain.scenario, sample_time=case.scenario.sample_time) == case.scenario

    @property
    def _workers(self) -> int:
        return self.workers or available_cores()

    def _bench(self, controller: Controller) -> Bench:
        limits = Limits(memory=int(self.memory_limit))
        return Bench(self.manipulator.archive, controller.archive, controller.setup, self.timeout, limits, self.sandbox)

    def _run(
        self,
        cases: Sequence[Case],
        bench: Bench,
        known: store.Store,
        at_once: CaseRun | None,
        keep_going: bool,
        force: bool,
        on_result: OnResult | None,
    ) -> list[CaseRun]:
        """Runs of all ``cases`` in their order: those in the store, and the others, stored as they come."""
        keys = stored.keys(self.rules, cases, bench)
        if force:
            known.forget(keys.values())
        found = {run.case.id: run for run in stored.load(known, keys, cases, bench, not keep_going)}
        if found:
            logger.info(
                "%d of %d cases are there from an earlier run", len(found), len(cases), extra={"what": "stored"}
            )
        waiting = [case for case in cases if case.id not in found]
        execute = (
            functools.partial(cluster.run, address=self.scheduler)
            if self.scheduler
            else functools.partial(pool.run, workers=self._workers)
        )
        for number, run in enumerate(found.values(), start=1):
            _tell(on_result, run, number, len(cases))
        stream = campaign.run_cases(self.rules, waiting, bench, execute, list(found.values()), keep_going, at_once)
        with closing(stream):
            for run in stream:
                stored.keep(known, keys[run.case.id], run, bench)
                found[run.case.id] = run
                _tell(on_result, run, len(found), len(cases))
        return [found[case.id] for case in cases]


def _tell(on_result: OnResult | None, run: CaseRun, done: int, total: int) -> None:
    if on_result is not None:
        on_result(run.result, done, total)


def _chosen(cases: Sequence[Case], only: Sequence[str] | str) -> tuple[Case, ...]:
    patterns = [only] if isinstance(only, str) else only
    if not patterns:
        return tuple(cases)
    chosen = tuple(case for case in cases if any(fnmatch.fnmatchcase(case.id, pattern) for pattern in patterns))
    if not chosen:
        wanted = " ".join(patterns)
        raise InputError(
            f"No case matches {wanted}. Cases are named like {cases[0].id} and {cases[-1].id}.", "no-case", "", wanted
        )
    return chosen
