"""The benchmark: a protocol, a seed, a plant and the conditions controllers are tried under."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from ..documents.document import Displayable
from ..entry import entered
from ..errors import InputError
from ..pairing.built_in import AUTO, NATIVE, PYTHON
from ..pairing.controller import Controller, Given
from ..pairing.testbed import Testbed
from ..views.table import Column, Summary, Table

# Imports inside functions: each use case is loaded when it is first used. All of them take longer than a simulation.

if TYPE_CHECKING:
    from ..benchmark.case import Case
    from ..benchmark.linearization import Friction
    from ..benchmark.variation import Variation
    from ..conformance.finding import Finding
    from ..documents.evaluation import Evaluation
    from ..documents.findings import Findings
    from ..documents.reliability import Reliability
    from ..documents.robustness import Robustness
    from ..documents.spread import Spread
    from ..documents.ssp import Order
    from ..documents.sweep import Sweep
    from ..documents.tuning import Tuning
    from ..documents.verification import Verification
    from ..pairing.runs import CaseRun
    from ..search.candidates import Range, Trial
    from ..study.declaration import Study
    from ..study.dry_run import DryRun
    from ..study.engine import Engine, OnEvent
    from ..study.requests import Event, OnResult
    from .linear import LinearLoop, LinearModel
    from .simulation import Simulation

    OnSeed = Callable[[int, Evaluation], None]
    OnProgress = Callable[[str, int, float, float | None, Mapping[str, float | None]], None]
    OnTrial = Callable[[Trial, int, int], None]

T = TypeVar("T")

TRIAL = ("trial", "done", "total")
"""Of a :class:`.TrialDone`, what callbacks get; the best so far is for the lines of commands."""


@dataclass(frozen=True)
class Benchmark(Testbed, Displayable):
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

        chosen = Controller.of(controller)
        return Findings(chosen.file_name, tuple(self.iter_check(chosen)))

    @entered
    def iter_check(self, controller: Controller) -> Iterator[Finding]:
        """The findings of :meth:`check` as they come."""
        from . import checking

        return checking.findings(controller, lambda: self.pairing(controller), self.rules, self.cases)

    @entered
    def run(
        self,
        study: Study[T],
        controller: Given = None,
        *,
        folder: str | Path | None = None,
        on_result: OnResult | None = None,
        on_event: OnEvent | None = None,
    ) -> T:
        """Run a study under these conditions, and give its document.

        Parameters
        ----------
        study : Study
            With its options, such as ``ReliabilityStudy(probability=0.001)``.
        controller : Controller or path, optional
            By default the paper's PID.
        folder : path, optional
            Where finished simulations are stored as they come and found again, so that an interrupted study goes on;
            the document is saved there, too. By default nothing is written.
        on_result : callable, optional
            ``on_result(result, done, total)`` is called for each case.
        on_event : callable, optional
            ``on_event(event)`` is called for each event of the study, such as a finished stage of a search.

        Raises
        ------
        InputError
            If controller, protocol, options or folder cannot be used.
        FmuError, Crash
            If the controller refuses, or does not survive, its first sample.
        EnvironmentFault
            If this machine or the cluster fails, or a package is missing; what is finished is kept in ``folder``.
        """
        place = None if study.on_this_machine or folder is None else Path(folder)
        engine = self.engine(place, on_result, on_event, study.on_this_machine)
        return engine.run(study.ask(self, Controller.of(controller), place))

    @entered
    def plan(self, study: Study[Any], controller: Given = None, *, folder: str | Path | None = None) -> DryRun:
        """What :meth:`run` would simulate, and how long that would take. Nothing is written."""
        place = None if study.on_this_machine or folder is None else Path(folder)
        engine = self.engine(place, here=study.on_this_machine)
        return engine.plan(study.ask(self, Controller.of(controller), place))

    @entered
    def evaluate(
        self,
        controller: Given = None,
        *,
        folder: str | Path | None = None,
        on_result: OnResult | None = None,
        **options: Any,
    ) -> Evaluation:
        """:meth:`run` the protocol once; the options are those of an :class:`.EvaluationStudy`."""
        from ..study.declaration import made
        from ..study.evaluate import EvaluationStudy

        return self.run(made(EvaluationStudy, "evaluate", **options), controller, folder=folder, on_result=on_result)

    @entered
    def spread(
        self,
        controller: Given = None,
        seeds: Iterable[int] = range(10),
        *,
        folder: str | Path | None = None,
        on_seed: OnSeed | None = None,
        on_result: OnResult | None = None,
        **options: Any,
    ) -> Spread:
        """:meth:`run` the protocol once with each of ``seeds``, whatever ``seed`` is, as a :class:`.SpreadStudy`.

        The options are those of :meth:`evaluate`. Each seed is evaluated in its own folder ``seed-N`` in ``folder``;
        ``on_seed(seed, evaluation)`` is called after each.
        """
        from ..study.declaration import made
        from ..study.evaluate import EvaluationStudy, SpreadStudy
        from ..study.requests import SeedDone

        study = SpreadStudy(seeds, made(EvaluationStudy, "spread", **options))
        return self.run(study, controller, folder=folder, on_result=on_result, on_event=_told(SeedDone, on_seed))

    @entered
    def robustness(
        self,
        controller: Given = None,
        *,
        folder: str | Path | None = None,
        on_progress: OnProgress | None = None,
        **options: Any,
    ) -> Robustness:
        """:meth:`run` a search for the worst case; the options are those of a :class:`.RobustnessStudy`.

        ``on_progress(stage, simulations, spent, cost, worst)`` is called after each stage and round.
        """
        from ..study.declaration import made
        from ..study.requests import StageDone
        from ..study.worst_case import RobustnessStudy

        study = made(RobustnessStudy, "robustness", **options)
        return self.run(study, controller, folder=folder, on_event=_told(StageDone, on_progress))

    @entered
    def reliability(
        self,
        controller: Given = None,
        *,
        folder: str | Path | None = None,
        on_result: OnResult | None = None,
        **options: Any,
    ) -> Reliability:
        """:meth:`run` a sample of independent draws; the options are those of a :class:`.ReliabilityStudy`."""
        from ..study.declaration import made
        from ..study.reliability import ReliabilityStudy

        return self.run(
            made(ReliabilityStudy, "reliability", **options), controller, folder=folder, on_result=on_result
        )

    @entered
    def tune(
        self,
        controller: Given = None,
        vary: Mapping[str, Range | tuple[float, float] | tuple[float, float, str]] | None = None,
        *,
        folder: str | Path | None = None,
        on_trial: OnTrial | None = None,
        **options: Any,
    ) -> Tuning:
        """:meth:`run` a search for parameters: ``{"K_p[1]": (20, 80, "log"), "z_p[1]": (0.8, 0.99)}``.

        The options are those of a :class:`.TuningStudy`. The search begins at the controller's values;
        ``on_trial(trial, done, total)`` is called for each candidate. Beside the document, parameters (``best.toml``),
        Optuna's study, and the evaluations of the best candidate are saved in ``folder``.
        """
        from ..study.declaration import made
        from ..study.requests import TrialDone
        from ..study.tune import TuningStudy

        study = made(TuningStudy, "tune", vary or {}, **options)
        return self.run(study, controller, folder=folder, on_event=_told(TrialDone, on_trial, *TRIAL))

    @entered
    def sweep(
        self,
        controller: Given = None,
        values: Mapping[str, Sequence[float]] | None = None,
        *,
        folder: str | Path | None = None,
        on_trial: OnTrial | None = None,
        **options: Any,
    ) -> Sweep:
        """:meth:`run` a grid of parameter values: ``{"K_p[1]": [20, 40, 80], "z_p[1]": [0.8, 0.9]}``.

        The options are those of a :class:`.SweepStudy`; ``on_trial(trial, done, total)`` is called for each
        combination.
        """
        from ..study.declaration import made
        from ..study.requests import TrialDone
        from ..study.sweep import SweepStudy

        study = made(SweepStudy, "sweep", values or {}, **options)
        return self.run(study, controller, folder=folder, on_event=_told(TrialDone, on_trial, *TRIAL))

    @entered
    def verify(self, controller: Given = None, *, on_result: OnResult | None = None, **options: Any) -> Verification:
        """:meth:`run` a verification; the options are those of a :class:`.VerificationStudy`.

        The document is the certificate: mean and spread over the draws beside those of the references, and what
        repeats it.
        """
        from ..study.declaration import made
        from ..study.verify import VerificationStudy

        return self.run(made(VerificationStudy, "verify", **options), controller, on_result=on_result)

    @entered
    def repeat(
        self, certificate: Verification, controller: str | Path | None = None, *, on_result: OnResult | None = None
    ) -> Verification:
        """Do the verification of a ``certificate`` again, with the FMU it is about (by default the paper's PID).

        :func:`~orchestrator.documents.verification.differences` compares the two. Raises :class:`InputError` if the FMU
        is another one, and what :meth:`verify` raises.
        """
        from ..study.verify import repeat

        file = None if controller is None else Path(controller)
        return self.engine(None, on_result, here=True).run(repeat(self, certificate, file))

    @entered
    def simulate(self, controller: Given = None, case: Case | str = "c07.compliant.disturbance") -> Simulation:
        """Simulate one case, by name or from :meth:`case`, :meth:`case_at`, :meth:`varied`.

        Raises :class:`InputError` for a case that does not exist, :class:`FmuError` if an FMU fails before the first
        sample, :class:`Crash` if the simulation's process ends before the simulation.
        """
        from .simulation import simulate

        return simulate(self, Controller.of(controller), case)

    @entered
    def export_ssp(self, controller: Given, case: Case | str, file: str | Path, order: Order = "parallel") -> Path:
        """Write the closed loop of one case, named as in :meth:`simulate`, as a package of SSP 1.0; returns ``file``.

        It holds the manipulator in C, the controller, and an FMU of all that the master does between them, with their
        parameters. ``order`` is that in which the master exchanges values: ``"parallel"`` for ecos, whose FMUs have
        steps of their own, or ``"in-sequence"`` for OMSimulator.

        Raises :class:`InputError` for a case that does not exist or cannot be had so, :class:`EnvironmentFault` where
        there is no C compiler.
        """
        from .simulation import export_ssp

        export_ssp(self, Controller.of(controller), case, Path(file), order)
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
        from .linear import linear_model

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
        from .linear import linear_loop

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

        execute = engine.local_executor(self) if here else engine.chosen_executor(self)
        return engine.Engine(execute, self.processes, None if folder is None else Path(folder), on_run, on_event)


def _told(kind: type, call: Callable[..., None] | None, *names: str) -> OnEvent:
    """Calls ``call`` with the fields ``names`` of each event of this kind, by default with all."""

    def told(event: Event) -> None:
        if call is not None and isinstance(event, kind):
            call(*(getattr(event, name) for name in names or vars(event)))

    return told
