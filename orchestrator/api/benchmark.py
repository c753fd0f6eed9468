"""The benchmark: a protocol, a seed, a plant and the conditions controllers are tried under."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..documents.document import Shown
from ..documents.standard import USUAL
from ..entry import entered
from ..errors import InputError
from ..pairing.controller import Controller, Given
from ..pairing.plant import AUTO, NATIVE, PYTHON
from ..pairing.testbed import Testbed
from ..search.findings import BUDGET
from ..views.table import Column, Summary, Table

# Imports inside functions: each use case is loaded when it is first used. All of them take longer than a simulation.

if TYPE_CHECKING:  # each use case is loaded when it is first used: all of them take longer than a simulation
    from typing_extensions import Unpack

    from ..benchmark.case import Case
    from ..benchmark.draws import Entropy
    from ..benchmark.linearization import Friction
    from ..benchmark.reliability import Distribution
    from ..benchmark.variation import Variation
    from ..conformance.finding import Finding
    from ..documents.evaluation import Evaluation
    from ..documents.findings import Findings
    from ..documents.reliability import Reliability
    from ..documents.robustness import Robustness
    from ..documents.spread import Spread
    from ..documents.sweep import Sweep
    from ..documents.tuning import Tuning
    from ..documents.verification import Verification
    from ..pairing.runs import CaseRun
    from ..search.candidates import Range, Trial
    from ..study.engine import Engine, OnEvent
    from ..study.evaluate import Options
    from ..study.requests import Event, OnResult
    from .linear_loop import LinearLoop
    from .linear_model import LinearModel
    from .simulation import Simulation

    OnSeed = Callable[[int, Evaluation], None]
    OnProgress = Callable[[str, int, Mapping[str, float | None]], None]
    OnTrial = Callable[[Trial, int, int], None]


@dataclass(frozen=True)
class Benchmark(Testbed, Shown):
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
        ``"native"``, the manipulator in C; ``"python"``, the same in Python; ``"auto"``, the first where there is a
        compiler whose code gives the bits of the second, else the second; or an FMU of your own.
    timeout : float
        Processor time [s] that a simulation of 26 s may take; shorter ones get their share, all some seconds to start.
        A simulation that waits, without computing, may do so for twice as long.
    memory_limit : float
        Memory [bytes] that a simulation's process may use.
    sandbox : bool
        Whether FMUs run without network and with read-only files (needs bubblewrap).
    scheduler : str, optional
        Address of a Dask scheduler, ``"tcp://host:port"``, to evaluate on its cluster.
    wait : float
        Seconds to wait for a silent scheduler or worker, and for the first worker.
    command : str
        The command line that asks, if there is one; documents tell it.

    Raises
    ------
    InputError
        If the protocol or a plant parameter does not exist, or a number makes no sense.
    """

    def summary(self) -> Summary:
        """Protocol, seed, plant and limits."""
        rows = (
            ("protocol", str(self.protocol)),
            ("cases", str(len(self.cases))),
            ("seed", str(self.seed)),
            ("plant", str(self.plant)),
            ("changed parameters", ", ".join(f"{name} = {x:g}" for name, x in self.plant_parameters.items()) or "none"),
            ("processes", str(self.processes)),
            ("processor time of a simulation", f"{self.timeout:g} s"),
            ("memory of a simulation", f"{self.memory_limit / 1e6:g} MB"),
            ("sandbox", "yes" if self.sandbox else "no"),
        )
        return Summary("Benchmark", self.rules.name, (Table("Conditions", (Column("what"), Column("value")), rows),))

    @entered
    def check(self, controller: Given = None) -> Findings:
        """What can be said of a controller before any evaluation: what it is, how it is bound, how it behaves.

        Whatever is wrong with it is a finding, not an exception.
        """
        from ..documents.findings import Findings

        own = Controller.of(controller)
        return Findings(own.file_name, tuple(self.iter_check(own)))

    @entered
    def iter_check(self, controller: Controller) -> Iterator[Finding]:
        """The findings of :meth:`check` as they come."""
        from . import checking

        return checking.findings(controller, lambda: self.pairing(controller), self.rules, self.cases[0])

    @entered
    def evaluate(
        self,
        controller: Given = None,
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
        controller : Controller or path, optional
            By default the paper's PID.
        only : str or sequence of str
            Patterns with ``*`` and ``?``; only cases whose name matches one are run.
        folder : path, optional
            Where finished cases are stored as they come and found again, so that an interrupted evaluation goes on;
            the evaluation is saved there, too. By default nothing is written.
        recordings : bool
            Whether the cases that a report shows are simulated once more and recorded.
        keep_going : bool
            Whether to run on after three failures or two timeouts of one kind, and to run again what failed before.
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
        from ..study.evaluate import evaluate

        study = evaluate(
            self, Controller.of(controller), only=only, recordings=recordings, keep_going=keep_going, force=force
        )
        return self.engine(folder, on_result).run(study)

    @entered
    def spread(
        self,
        controller: Given = None,
        seeds: Iterable[int] = range(10),
        *,
        folder: str | Path | None = None,
        on_seed: OnSeed | None = None,
        on_result: OnResult | None = None,
        **options: Unpack[Options],
    ) -> Spread:
        """Run the protocol once with each of ``seeds``, whatever ``seed`` is: mean and standard deviation of V and of
        each criterion, and for how many seeds each requirement holds.

        Parameters
        ----------
        controller : Controller or path, optional
            By default the paper's PID.
        seeds : iterable of int
            Base seeds, by default 0 to 9.
        folder : path, optional
            Each seed is evaluated in its own folder ``seed-N`` in it, as by :meth:`evaluate`; the spread over those
            that are finished is saved there after each.
        on_seed : callable, optional
            ``on_seed(seed, evaluation)`` is called after each seed.
        on_result : callable, optional
            As in :meth:`evaluate`.
        **options
            ``only``, ``recordings``, ``keep_going`` and ``force`` of :meth:`evaluate`.

        Returns
        -------
        Spread

        Raises
        ------
        InputError, FmuError, EnvironmentFault
            As :meth:`evaluate`, or for no seed at all.
        """
        from ..study.evaluate import spread
        from ..study.requests import SeedDone

        return self.engine(folder, on_result, _told(SeedDone, on_seed)).run(
            spread(self, Controller.of(controller), seeds, **options)
        )

    @entered
    def robustness(
        self,
        controller: Given = None,
        *,
        budget: int = BUDGET,
        minutes: float = math.inf,
        protocol: str | Path = "strict",
        only: Sequence[str] = (),
        from_list: bool = True,
        restarts: int = 1,
        folder: str | Path | None = None,
        recordings: bool = True,
        on_progress: OnProgress | None = None,
    ) -> Robustness:
        """Search for the worst case: is there an arm within the tolerances for which the controller fails, and which?

        Each failure comes with a command that reproduces it. If the search finds no failure, the controller may still
        have one.

        Parameters
        ----------
        controller : Controller or path, optional
            By default the paper's PID.
        budget : int
            Simulated time that is not exceeded, in whole cases: a short simulation costs its share of the longest
            test's 26 s. What is simulated until 60 s in doubt about its verdict does not cost more. Each stage has its
            share; ``Robustness.cut_short`` names those that wanted more.
        minutes : float
            Time after which what was found is confirmed, and margins and radius are left out.
        protocol : str or path
            A protocol that draws nothing; its cases are the list that the search begins with.
        only : sequence of str
            What to search for, of ``"B5"``, ``"B6"``, ``"B7"`` and the tests of A1 and A2 such as ``"delay_2"``; by
            default everything.
        from_list : bool
            Whether to begin with it, or with the nominal system alone.
        restarts : int
            Independent starts of the search for V, which share its budget; ``Robustness.starts`` holds what each found.
        folder : path, optional
            Where finished simulations are stored as they come and found again; the answer is saved there, too.
        recordings : bool
            Whether the worst cases, and the nominal arm beside them, are simulated once more and recorded in ``folder``
            for its report: up to twelve simulations beside the budget.
        on_progress : callable, optional
            ``on_progress(stage, simulations, spent, cost, worst)`` is called after each stage and round.

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
        from ..study.requests import StageDone
        from ..study.worst_case import answer_of, worst_case

        own = recordings and folder is not None
        study = answer_of(
            worst_case(self, Controller.of(controller), budget, minutes, protocol, only, from_list, restarts, own)
        )
        return self.engine(folder, None, _told(StageDone, on_progress)).run(study)

    @entered
    def reliability(
        self,
        controller: Given = None,
        *,
        draws: int | None = None,
        probability: float = 0.01,
        confidence: float = 0.99,
        distribution: Distribution = "box",
        folder: str | Path | None = None,
        on_result: OnResult | None = None,
    ) -> Reliability:
        """How likely a failure is at most: independent draws of arm, pose, direction of the force, sweep and noise.

        Parameters
        ----------
        controller : Controller or path, optional
            By default the paper's PID.
        draws : int, optional
            By default as many as bound the probability of failure by ``probability`` if none fails. Draw k depends on
            k, the seed and the distribution alone.
        probability, confidence : float
            Of the bounds of the criteria; the confidence also of those of the probabilities of failure.
        distribution : "box" or "corners"
            Of the uncertain parameters: uniform within Table 1, or each at one of its two ends.
        folder : path, optional
            Where finished simulations are stored as they come and found again; the answer is saved there, too.
        on_result : callable, optional
            ``on_result(result, done, total)`` is called for each case.

        Returns
        -------
        Reliability

        Raises
        ------
        InputError
            If controller, numbers, protocol or folder cannot be used.
        FmuError, Crash
            If the controller refuses, or does not survive, its first sample.
        EnvironmentFault
            If this machine or the cluster fails; what is finished is kept in ``folder``.
        """
        from ..benchmark.reliability import draws_needed
        from ..study.reliability import reliability

        count = draws_needed(probability, confidence) if draws is None else draws
        study = reliability(self, Controller.of(controller), count, probability, confidence, distribution)
        return self.engine(folder, on_result).run(study)

    @entered
    def tune(
        self,
        controller: Given = None,
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
        controller : Controller or path, optional
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
            Budget, in whole cases, of a search for the worst case of each candidate that holds the whole protocol, as
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
        from ..search.proposals import STUDY
        from ..study.requests import TrialDone
        from ..study.tune import tune

        study = tune(
            self,
            Controller.of(controller),
            vary or {},
            objective,
            strict,
            trials,
            robust,
            sampler,
            search_seed,
            None if folder is None else Path(folder) / STUDY,
        )
        return self.engine(folder, None, _told(TrialDone, on_trial)).run(study)

    @entered
    def sweep(
        self,
        controller: Given = None,
        values: Mapping[str, Sequence[float]] | None = None,
        *,
        objective: str | Path = "tuning",
        folder: str | Path | None = None,
        on_trial: OnTrial | None = None,
    ) -> Sweep:
        """V and stability over a grid of parameter values: every combination of them.

        Parameters
        ----------
        controller : Controller or path, optional
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
        from ..study.requests import TrialDone
        from ..study.sweep import sweep

        study = sweep(replace(self, protocol=objective), Controller.of(controller), values or {})
        return self.engine(folder, None, _told(TrialDone, on_trial)).run(study)

    @entered
    def verify(
        self,
        controller: Given = None,
        *,
        draws: Entropy | None = None,
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
        controller : Controller or path, optional
            By default the paper's PID.
        draws : Entropy, optional
            What the draws follow from: :func:`~orchestrator.benchmark.draws.from_beacon` gives the bits of a public
            beacon; fresh ones of this machine by default.
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
        from ..study.engine import can_fence
        from ..study.verify import verify

        same, sandboxed = replace(self, protocol=protocol), self.sandbox or can_fence()
        study = verify(same, Controller.of(controller), draws, count, strict, tuple(beside), sandboxed)
        return self.engine(None, on_result, here=True).run(study)

    @entered
    def repeat(
        self, certificate: Verification, controller: str | Path | None = None, *, on_result: OnResult | None = None
    ) -> Verification:
        """Do the verification of a ``certificate`` again, with the FMU it is about (by default the paper's PID).

        :func:`~orchestrator.documents.verification.differences` compares the two. Raises :class:`InputError` if the FMU
        is another one, and what :meth:`verify` raises.
        """
        from ..study.engine import can_fence
        from ..study.verify import repeat

        file, sandboxed = None if controller is None else Path(controller), self.sandbox or can_fence()
        return self.engine(None, on_result, here=True).run(repeat(self, certificate, file, sandboxed))

    @entered
    def simulate(self, controller: Given = None, case: Case | str = "c07.compliant.disturbance") -> Simulation:
        """Simulate one case, by name or from :meth:`case`, :meth:`case_at`, :meth:`varied`.

        Raises :class:`InputError` for a case that does not exist, :class:`FmuError` if an FMU fails before the first
        sample, :class:`Crash` if the simulation's process ends before the simulation.
        """
        from .simulating import simulate

        return simulate(self, Controller.of(controller), case)

    @entered
    def export_ssp(self, controller: Given, case: Case | str, file: str | Path) -> Path:
        """Write the closed loop of one case, named as in :meth:`simulate`, as a package of SSP 1.0; returns ``file``.

        It holds the manipulator in C, the controller, and an FMU of all that the master does between them, with their
        parameters.

        Raises :class:`InputError` for a case that does not exist or cannot be had so, :class:`EnvironmentFault` where
        there is no C compiler.
        """
        from .simulating import export_ssp

        export_ssp(self, Controller.of(controller), case, Path(file))
        return Path(file)

    @entered
    def linearize(
        self,
        q_a: tuple[float, float],
        system: str = "nominal",
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
            delays the measurement, drops samples or has jitter.
        """
        from .linear_model import linear_model

        return linear_model(self._known(q_a, system, test, variation), sampled, delay, friction)

    @entered
    def linear_loop(
        self,
        controller: Given | object,
        q_a: tuple[float, float],
        system: str = "nominal",
        *,
        test: str = "disturbance",
        variation: Variation | None = None,
        friction: Friction = "sticking",
    ) -> LinearLoop:
        """The linearized plant in a loop with a controller: poles, sensitivity, stability margins.

        Parameters
        ----------
        controller : Controller, path or linear system
            An FMU, which is linearized at rest by its impulse response; or matrices: a ``.mat``, ``.npz`` or ``.json``
            file, or a system with A, B, C, D and a sample time, as for
            :func:`~controller_fmu.controller_from_state_space`.
        q_a, system, test, variation, friction
            As in :meth:`linearize`. The model is sampled with the controller's sample time.

        Raises
        ------
        InputError
            As :meth:`linearize`; if the controller cannot be used, or its FMU is not linear at rest.
        FmuError, Crash
            If the FMU fails.
        """
        from .linear_loop import linear_loop

        return linear_loop(self, controller, self._known(q_a, system, test, variation), friction)

    def _known(self, q_a: tuple[float, float], system: str, test: str, variation: Variation | None) -> Case:
        """The case to linearize; raises :class:`InputError` for a plant whose equations are not known."""
        if self.plant not in (AUTO, PYTHON, NATIVE):
            message = f"The equations of {self.plant} are not known; only the benchmark's manipulator is linearized."
            raise InputError(message, "no-equations", self.plant)
        return self.case_at(q_a, system, test, variation)

    @entered
    def engine(
        self,
        folder: str | Path | None = None,
        on_result: OnResult | None = None,
        on_event: OnEvent | None = None,
        here: bool = False,
    ) -> Engine:
        """What runs any study under these conditions, ``here`` on this machine or where it was asked for, with its
        files in ``folder``; results and events are told as they come."""
        from ..study import engine

        def on_run(run: CaseRun, done: int, total: int) -> None:
            if on_result is not None:
                on_result(run.result, done, total)

        execute = engine.here(self) if here else engine.where_asked(self)
        return engine.Engine(execute, self.processes, None if folder is None else Path(folder), on_run, on_event)


def _told(kind: type, call: Callable[..., None] | None) -> OnEvent:
    """Calls ``call`` with the fields of each event of this kind."""

    def told(event: Event) -> None:
        if call is not None and isinstance(event, kind):
            call(*vars(event).values())

    return told
