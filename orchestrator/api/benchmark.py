"""The benchmark: a protocol, a seed, a plant and the conditions controllers are tried under."""

from __future__ import annotations

import fnmatch
import functools
import math
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from plant_fmu.flexible_manipulator.parameters import NOMINAL

from ..benchmark import cases as case_list
from ..benchmark import protocol as protocols
from ..benchmark.case import Case
from ..benchmark.linearization import Friction, rest
from ..benchmark.metrics import judge, named
from ..benchmark.nominal import check_changes
from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult, RunTiming
from ..benchmark.scorecard import kind
from ..benchmark.variation import Variation, vary
from ..conformance.finding import Finding
from ..errors import Crash, InputError
from ..execution import cluster, pool, store
from ..execution.job import Limits
from ..fmi.archive import open_archive
from ..loop.sampling import controller_sample_time
from ..reporting.certificates import Verification
from ..reporting.files import REPORT, TRAJECTORIES, prepare_folder, remove, seed_folder, write_bytes
from ..reporting.recording import save as save_recordings
from ..reporting.repeat import Setting
from ..reporting.robustness import Robustness
from ..reporting.spread import Spread, spread_of
from ..reporting.sweep import Sweep
from ..reporting.tuning import Tuning
from ..search.candidates import Range
from . import campaign, checking, document
from .built_in import built_in
from .campaign import Bench
from .controller import Controller
from .evaluation import Evaluation
from .linear_model import LinearModel, linear_model
from .plant import AUTO, NATIVE, PYTHON, Plant, choose
from .recorder import record_shown
from .reference import USUAL
from .robustness import OnProgress, find_worst_case, sought
from .running import Runner
from .selection import Shown, shown
from .simulation import Simulation
from .sweeping import sweep
from .tuner import OnTrial
from .tuning import tune
from .verification import repeat, verify

if TYPE_CHECKING:
    from typing_extensions import Unpack

OnResult = Callable[[CaseResult, int, int], None]
"""Is told each result as it comes, how many there are, and how many there will be."""

OnSeed = Callable[[int, Evaluation], None]
"""Is told each seed with its evaluation."""


class Options(TypedDict, total=False):
    """Options of :meth:`Benchmark.evaluate` that hold for every seed."""

    only: Sequence[str] | str
    recordings: bool
    keep_going: bool
    force: bool
    on_result: OnResult | None


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
    wait : float
        Seconds to wait for a silent scheduler or worker, and for the first worker.

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
    wait: float = cluster.WAIT

    def __post_init__(self) -> None:
        if self.seed < 0 or (self.workers is not None and self.workers < 1):
            raise InputError("The seed must not be negative, and at least one worker is needed.", "bad-number")
        for name in ("timeout", "memory_limit", "wait"):
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
        pose = case_list.configuration(self.rules, *q_a, self.seed)
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
        return checking.findings(controller, lambda: self.bench(controller), self.rules, self.cases[0].scenario)

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
        controller, bench, sample_time, cases = self.prepared(controller)
        cases, target = _chosen(cases, only), None if folder is None else Path(folder)
        start, begin = datetime.now(timezone.utc), time.perf_counter()
        with self._runner(bench, target, keep_going) as runner:
            rehearsal = campaign.rehearse(cases[0], bench)
            computing_time = None if rehearsal.failure else campaign.computing_time(cases[0], bench)
            told = None if on_result is None else lambda run, done, total: on_result(run.result, done, total)
            runs = runner.run(cases, rehearsal.failure, force, told)
            timing = RunTiming(
                start.isoformat(timespec="seconds"),
                time.perf_counter() - begin,
                self.processes,
                sum(run.result.time for run in runs),
                sum(run.wall_time for run in runs),
                computing_time,
            )
            results = document.results(
                self.rules,
                str(self.protocol) if str(self.protocol) != self.rules.name else "",
                self.seed,
                bench,
                controller,
                document.plant_record(self.manipulator, self.plant_parameters),
                sample_time,
                rehearsal.timing,
                runs,
                timing,
            )
            evaluation = Evaluation(results)
            if target is not None:
                evaluation.save(target)  # before the recordings: whatever happens now, the results are there
            if recordings:
                wanted = shown(self.rules, self.nominal, self.seed, runs, results.scorecard)
                evaluation = replace(evaluation, recordings=record_shown(wanted, bench, self.processes))
                if target is not None:
                    evaluation.save(target)
        return evaluation

    def spread(
        self,
        controller: Controller | None = None,
        seeds: Iterable[int] = range(10),
        *,
        folder: str | Path | None = None,
        on_seed: OnSeed | None = None,
        **options: Unpack[Options],
    ) -> Spread:
        """Run the protocol once with each of ``seeds``, whatever ``seed`` is: mean and standard deviation of V and of
        each criterion, and for how many seeds each requirement holds.

        Parameters
        ----------
        controller : Controller, optional
            By default the paper's PID.
        seeds : iterable of int
            Base seeds, by default 0 to 9.
        folder : path, optional
            Each seed is evaluated in its own folder ``seed-N`` in it, as by :meth:`evaluate`; the spread over those
            that are finished is saved there after each.
        on_seed : callable, optional
            ``on_seed(seed, evaluation)`` is called after each seed.
        **options
            ``only``, ``recordings``, ``keep_going``, ``force`` and ``on_result`` of :meth:`evaluate`.

        Returns
        -------
        Spread

        Raises
        ------
        InputError, FmuError, EnvironmentFault
            As :meth:`evaluate`, or for no seed at all.
        """
        wanted, found = tuple(dict.fromkeys(seeds)), []
        benches = [replace(self, seed=seed) for seed in wanted]
        if not benches:
            raise InputError("At least one seed is needed.", "bad-number")
        for bench in benches:
            own = None if folder is None else Path(folder) / seed_folder(bench.seed)
            evaluation = bench.evaluate(controller, folder=own, **options)
            found.append(evaluation.results)
            spread = spread_of(wanted, found)
            if folder is not None:
                spread.save(folder)
            if on_seed is not None:
                on_seed(bench.seed, evaluation)
        return spread

    def robustness(
        self,
        controller: Controller | None = None,
        *,
        budget: int = 2000,
        minutes: float = math.inf,
        protocol: str | Path = "strict",
        only: Sequence[str] = (),
        from_list: bool = True,
        folder: str | Path | None = None,
        recordings: bool = True,
        on_progress: OnProgress | None = None,
    ) -> Robustness:
        """Search for the worst case: is there an arm within the tolerances for which the controller fails, and which?

        What is found is a proof, since its command repeats it; that nothing is found proves nothing.

        Parameters
        ----------
        controller : Controller, optional
            By default the paper's PID.
        budget : int
            Simulations that are not exceeded. Each stage has its share; ``Robustness.cut_short`` names those that
            wanted more.
        minutes : float
            Time after which what was found is confirmed, and margins and radius are left out.
        protocol : str or path
            A protocol that draws nothing; its cases are the list that the search begins with.
        only : sequence of str
            What to search for, of ``"B5"``, ``"B6"``, ``"B7"`` and the tests of A1 and A2 such as ``"delay_2"``; by
            default everything.
        from_list : bool
            Whether to begin with it, or with the nominal system alone.
        folder : path, optional
            Where finished simulations are stored as they come and found again; the answer is saved there, too.
        recordings : bool
            Whether the worst cases, and the nominal arm beside them, are simulated once more and recorded in ``folder``
            for its report: up to twelve simulations beside the budget.
        on_progress : callable, optional
            ``on_progress(stage, simulations, worst)`` is called after each stage and round.

        Returns
        -------
        Robustness

        Raises
        ------
        InputError
            If controller, protocol or folder cannot be used, or the budget is too small for the list.
        FmuError
            If the controller refuses its first sample.
        Crash
            If it hangs, or ends its process, in its first sample.
        EnvironmentFault
            If this machine or the cluster fails; what is finished is kept in ``folder``.
        """
        return self.searched(controller, budget, minutes, protocol, only, from_list, folder, recordings, on_progress)[0]

    def tune(
        self,
        controller: Controller | None = None,
        vary: Mapping[str, Range | tuple[float, float] | tuple[float, float, str]] | None = None,
        *,
        trials: int = 200,
        objective: str | Path = "tuning",
        strict: str | Path = "strict",
        robust: int = 0,
        sampler: str = "cmaes",
        search_seed: int = 1,
        folder: str | Path | None = None,
        on_trial: OnTrial | None = None,
    ) -> Tuning:
        """Search for parameters of a controller that make V small while A1 to A3 hold.

        Candidates are tried in a short protocol, and the best of them in this benchmark's own one, again and again:
        what fails there is added to the short one. It needs the packages Optuna and cmaes (the extra ``tuning``).

        Parameters
        ----------
        controller : Controller, optional
            By default the paper's PID. The search begins at its values.
        vary : mapping
            Ranges by parameter name, in the FMU's units: ``{"K_p[1]": (20, 80, "log"), "z_p[1]": (0.8, 0.99)}``.
        trials : int
            Candidates.
        objective : str or path
            The short protocol. V counts, and 4 for each factor e by which a limit cycle exceeds what A3 allows.
        strict : str or path
            The protocol whose list the best candidate is tried on, and a search for the worst case begins with.
        robust : int
            Simulations of a search for the worst case of each candidate that holds the whole protocol, as
            :meth:`robustness` makes it; what it finds is added to the objective, too. None by default.
        sampler : str
            Of Optuna: ``"cmaes"``, ``"tpe"`` or ``"random"``.
        search_seed : int
            Seed of the sampler.
        folder : path, optional
            Where finished simulations are stored as they come and found again: the same call goes on with an
            interrupted search, and comes to the same answer. Answer, parameters (``best.toml``), Optuna's study, and
            the evaluations of the best candidate are saved there, too.
        on_trial : callable, optional
            ``on_trial(trial, done, total)`` is called for each candidate.

        Returns
        -------
        Tuning

        Raises
        ------
        InputError
            If controller, ranges, protocol or folder cannot be used.
        FmuError, Crash
            If the controller refuses, or does not survive, its first sample at the values that the search begins with.
        EnvironmentFault
            If Optuna is missing, or this machine or the cluster fails; what is finished is kept in ``folder``.
        """
        target = None if folder is None else Path(folder)
        found = tune(
            self,
            controller or Controller(),
            vary or {},
            objective,
            strict,
            trials,
            robust,
            sampler,
            search_seed,
            target,
            on_trial,
        )
        if target is not None:
            found.save(target)
        return found

    def sweep(
        self,
        controller: Controller | None = None,
        values: Mapping[str, Sequence[float]] | None = None,
        *,
        objective: str | Path = "tuning",
        folder: str | Path | None = None,
        on_trial: OnTrial | None = None,
    ) -> Sweep:
        """V and stability over a grid of parameter values: every combination of them.

        Parameters
        ----------
        controller : Controller, optional
            By default the paper's PID.
        values : mapping
            Values by parameter name, in the FMU's units: ``{"K_p[1]": [20, 40, 80], "z_p[1]": [0.8, 0.9]}``.
        objective : str or path
            The protocol that they are tried in, with this benchmark's seed.
        folder : path, optional
            Where finished simulations are stored as they come and found again; the answer is saved there, too.
        on_trial : callable, optional
            ``on_trial(trial, done, total)`` is called for each combination.

        Returns
        -------
        Sweep

        Raises
        ------
        InputError
            If controller, values, protocol or folder cannot be used.
        FmuError, Crash
            If the controller refuses, or does not survive, its first sample at its own values.
        EnvironmentFault
            If this machine or the cluster fails; what is finished is kept in ``folder``.
        """
        short = replace(self, protocol=objective)
        return sweep(
            short, controller or Controller(), values or {}, None if folder is None else Path(folder), on_trial
        )

    def verify(
        self,
        controller: Controller | None = None,
        *,
        draws: str | None = None,
        count: int = 3,
        strict: bool = True,
        beside: Sequence[str] = USUAL,
        protocol: str | Path = "verification",
        on_result: OnResult | None = None,
    ) -> Verification:
        """Evaluate where the controller can reach neither judge nor draws: the result one can trust.

        The controller runs in a new process for each simulation, in the sandbox where there is one; plant, noise and
        judge are in a process that never loads it. The draws are made after its FMU has been read. It runs on this
        machine, and nothing is written.

        Parameters
        ----------
        controller : Controller, optional
            By default the paper's PID.
        draws : str, optional
            What the draws follow from, such as a date or a beacon published after the controller; fresh entropy by
            default.
        count : int
            Number of draws.
        strict : bool
            Whether to run the worst poses of the protocol ``strict`` as well, moved by the first draw.
        beside : sequence of str
            The references, out of ``"DiagonalPID"``, ``"TunedPID"``, ``"DitheredLQG"``, ``"ManipulatorLQG"``.
        protocol : str or path
            What is run once per draw.
        on_result : callable, optional
            ``on_result(result, done, total)`` is called for each case, those of the references included.

        Returns
        -------
        Verification
            The certificate: mean and spread over the draws beside those of the references, and what repeats it.

        Raises
        ------
        InputError
            If the controller cannot be used, a reference is unknown, or there is no sandbox though one was asked for.
        FmuError
            If the controller refuses its first sample.
        EnvironmentFault
            If this machine fails.
        """
        same = replace(self, protocol=protocol)
        return verify(same, controller or Controller(), draws, count, strict, tuple(beside), on_result)

    def repeat(
        self, certificate: Verification, controller: str | Path | None = None, *, on_result: OnResult | None = None
    ) -> Verification:
        """Do the verification of a ``certificate`` again, with the FMU it is about (by default the paper's PID).

        :func:`~orchestrator.reporting.certificates.differences` compares the two. Raises :class:`InputError` if the FMU
        is another one, and what :meth:`verify` raises.
        """
        return repeat(self, certificate, None if controller is None else Path(controller), on_result)

    def simulate(
        self, controller: Controller | None = None, case: Case | str = "c07.compliant.disturbance"
    ) -> Simulation:
        """Simulate one case, by name or from :meth:`case`, :meth:`case_at`, :meth:`varied`.

        Raises :class:`InputError` for a case that does not exist, :class:`FmuError` if an FMU fails before the first
        sample, :class:`Crash` if the simulation's process ends before the simulation.
        """
        bench, wanted = self._sampled(controller or Controller(), case)
        scenario = wanted.scenario
        trajectory = campaign.simulate(bench, scenario)
        result = named(wanted, judge(self.rules, wanted, trajectory))
        plain = case_list.case(self.rules, wanted.configuration, wanted.system, wanted.test, self.seed).scenario
        varied = replace(plain, sample_time=scenario.sample_time) != scenario
        return Simulation(wanted, bench.controller.name, trajectory, result, varied, kind(result, self.rules.stability))

    def export_ssp(self, controller: Controller | None, case: Case | str, file: str | Path) -> Path:
        """Write the closed loop of one case, named as in :meth:`simulate`, as a package of SSP 1.0; returns ``file``.

        It holds the manipulator in C, the controller, and an FMU of all that the master does between them, with their
        parameters.

        Raises :class:`InputError` for a case that does not exist or cannot be had so, :class:`EnvironmentFault` where
        there is no C compiler.
        """
        from ..loop.controller import Steady  # loads Numba
        from ..reporting.ssp import package

        bench, wanted = self._sampled(controller or Controller(), case)
        scenario, pose = wanted.scenario, wanted.configuration
        at = rest(dict(scenario.parameters), (pose.q_a1, pose.q_a2))
        plant, imperfections = (open_archive(built_in(name)) for name in ("FlexibleManipulatorNative", "Imperfections"))
        steady = Steady(at.q_m, at.u_m, at.q_a)
        write_bytes(Path(file), package(plant, imperfections, bench.controller, bench.setup, scenario, steady))
        return Path(file)

    def _sampled(self, controller: Controller, case: Case | str) -> tuple[Bench, Case]:
        """A case, sampled by the controller."""
        bench = self.bench(controller)
        wanted = self.case(case) if isinstance(case, str) else case
        T_s = controller_sample_time(bench.controller, wanted.scenario.sample_time, controller.given_sample_time)
        return bench, replace(wanted, scenario=replace(wanted.scenario, sample_time=T_s.value))

    def linearize(
        self,
        q_a: tuple[float, float],
        system: str = "compliant",
        *,
        test: str = "disturbance",
        variation: Variation | None = None,
        sampled: bool = True,
        delay: bool = True,
        friction: Friction = "sticking",
    ) -> LinearModel:
        """The plant, linearized at rest: deviations of q_m and X by those of u_m, u_d and F.

        Every element is the derivative of the benchmark's equations in closed form, exact up to rounding.

        Parameters
        ----------
        q_a : tuple of float
            Link angles [rad].
        system, test, variation
            As in :meth:`case_at`. Of the test and the variation count what they do to u_m: gain and delay.
        sampled : bool
            Whether the model is that of the samples: inputs held over the benchmark's sample time. Else it is
            continuous, and has no delay.
        delay : bool
            Whether the sampled model has the loop's delay from u_m to the motor, as states behind the plant's.
        friction : str
            ``"sticking"``, the slope of eq. (8) at zero speed: the derivative at rest. Or ``"sliding"``, the viscous
            part alone: an arm that moves, which is what a controller is designed for.

        Raises
        ------
        InputError
            As :meth:`case_at`; if the plant is an FMU of your own, whose equations are not known; or if the variation
            delays the measurement.
        """
        if self.plant not in (AUTO, PYTHON, NATIVE):
            message = f"The equations of {self.plant} are not known; only the benchmark's manipulator is linearized."
            raise InputError(message, "no-equations", self.plant)
        return linear_model(self.case_at(q_a, system, test, variation), sampled, delay, friction)

    @property
    def processes(self) -> int:
        """How many processes at a time."""
        return self.workers or available_cores()

    @property
    def execute(self) -> campaign.Execute:
        """What runs jobs: processes of this machine, or the scheduler's."""
        if self.scheduler:
            return functools.partial(cluster.run, address=self.scheduler, wait=self.wait)
        return functools.partial(pool.run, workers=self.processes)

    def bench(self, controller: Controller) -> Bench:
        """Manipulator and controller, and the conditions they run under."""
        limits = Limits(memory=int(self.memory_limit))
        return Bench(self.manipulator.archive, controller.archive, controller.setup, self.timeout, limits, self.sandbox)

    def prepared(self, controller: Controller | None) -> tuple[Controller, Bench, Fraction, tuple[Case, ...]]:
        """The controller, by default the paper's PID, with its bench, its sample time [s] and all cases at that."""
        controller = controller or Controller()
        bench = self.bench(controller)
        T_s = controller_sample_time(bench.controller, self.rules.sample_time, controller.given_sample_time).value
        return controller, bench, T_s, case_list.cases(self.rules, self.nominal, self.seed, T_s)

    def searched(
        self,
        controller: Controller | None,
        budget: int,
        minutes: float = math.inf,
        protocol: str | Path = "strict",
        only: Sequence[str] = (),
        from_list: bool = True,
        folder: str | Path | None = None,
        recordings: bool = False,
        on_progress: OnProgress | None = None,
    ) -> tuple[Robustness, list[Shown]]:
        """The answer of :meth:`robustness`, and the worst cases, each followed by that of the nominal arm."""
        own = replace(self, protocol=protocol)
        controller, bench, T_s, cases = own.prepared(controller)
        listed = cases if from_list else ()
        wanted = sought(own.rules, listed, budget, only)
        setting = Setting(
            document.controller_record(bench, controller),
            document.plant_record(self.manipulator, self.plant_parameters),
            str(protocol),
            self.seed,
            None if T_s == own.rules.sample_time else float(T_s),
        )
        target = None if folder is None else Path(folder)
        with own._runner(bench, target) as runner:
            if (failure := campaign.rehearse(cases[0], bench).failure) is not None:
                raise Crash(failure.result.message)
            found, worst = find_worst_case(
                runner, listed, wanted, own.nominal, setting, T_s, budget, minutes, on_progress
            )
            if target is not None:
                for name in (TRAJECTORIES, REPORT):  # of another search
                    remove(target / name)
                found.save(target)  # before the recordings: whatever happens now, the answer is there
                if recordings:
                    save_recordings(record_shown(worst, bench, self.processes), target)
        return found, worst

    @contextmanager
    def _runner(self, bench: Bench, folder: Path | None, keep_going: bool = False) -> Iterator[Runner]:
        """What runs cases, with the store in ``folder``, which is created if missing."""
        if folder is not None:
            prepare_folder(folder)
        with store.opened(folder) as known:
            yield Runner(self.rules, bench, self.execute, known, keep_going)


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
