"""What can be said before any evaluation: of a controller FMU, and whether this machine gives the published bits."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from msgspec import structs

from build_fmus import find_compiler

from ..benchmark.bits import CASES, PAIRS, BitComparison, Pair, hash_of, published, short_case
from ..benchmark.case import Case
from ..benchmark.protocol import Protocol
from ..codec import Struct, unpack
from ..conformance.finding import Finding, Severity
from ..conformance.static import archive_findings, binding_findings, sampling_findings
from ..errors import Crash, FmuError, InputError
from ..execution.job import Died, Done, Outcome
from ..execution.messages import Failed
from ..execution.supervision import run_isolated
from ..loop import behaviour
from ..loop.behaviour import CarryOver
from ..loop.sampling import controller_sample_time
from ..loop.setup import controller_binding
from ..pairing import work
from ..pairing.built_in import built_in
from ..pairing.controller import Controller
from ..pairing.pairing import FULL_LENGTH, GROUP_SIZE, Pairing, simulate
from ..pairing.testbed import Testbed, available_cores
from ..study.rehearsal import computing_time, rehearse

Decode = Callable[[int, bytes], Any]
"""As that of a job."""

CHECK_TIMEOUT = 10.0
"""Processor time [s] that a look at the running controller may take; waiting is limited as well, see
:mod:`~orchestrator.execution.time_limit`."""


def findings(
    controller: Controller, pairing: Callable[[], Pairing], protocol: Protocol, cases: Sequence[Case]
) -> Iterator[Finding]:
    """The findings on ``controller`` as they come; ``pairing`` opens it, the beginnings of ``cases`` are simulated."""
    try:
        yield from archive_findings(controller.archive)
        opened = pairing()
        archive, setup = opened.controller, opened.setup
        yield from binding_findings(controller_binding(archive, setup), archive, setup)
        sample_time = controller_sample_time(archive, protocol.sample_time, controller.given_sample_time)
        yield from sampling_findings(sample_time, protocol.sample_time)
        # As many as an evaluation has in one process, a long one first, then others at each pose: some FMUs count
        # their instances, others keep what belongs to a pose, or what a force has left.
        telling = max(cases, key=lambda case: (bool(case.test.criteria), case.scenario.duration))
        last = {case.configuration.index: case for case in cases}
        chosen = (cases[0], telling, *last.values())
        sampled = [
            replace(case, scenario=replace(case.scenario, sample_time=sample_time.value))
            for case in chosen[: 1 + GROUP_SIZE]
        ]
        yield from _dynamic(opened, sampled, protocol)
    except InputError as error:
        yield Finding(Severity.ERROR, "import", str(error), "", error.what, error.value, error.nearest)


def _dynamic(pairing: Pairing, cases: Sequence[Case], protocol: Protocol) -> Iterator[Finding]:
    """What running the controller shows. Each look takes one instance of a process that may have only one."""
    from ..conformance import dynamic  # it loads the compiler

    case = cases[0]
    T_s, told = case.scenario.sample_time, set[str]()

    def failed(check: dynamic.Check, outcome: Outcome) -> Iterator[Finding]:
        """What it means that a look at the subject of ``check`` came to this ``outcome``."""
        if isinstance(outcome, Failed):
            error = outcome.error
            text, remedy = error.message, check.loss or "Mend what the FMU says itself, and export it again."
            cause = error.what, error.value, error.nearest
        elif isinstance(outcome, Died):
            text = "\n".join((outcome.message, *outcome.output))
            remedy = check.loss or "Run the FMU in a debugger: it ends or hangs its process."
            cause = "", "", ()
        else:
            return
        if text not in told:  # it fails before any look begins: once is enough
            told.add(text)
            yield Finding(check.failure, check.subject, text, remedy, *cause)

    def run(bench: Pairing, function: Callable[..., bytes], tasks: Sequence[Struct], decode: Decode) -> list[Outcome]:
        name = f"{function.__module__}:{function.__name__}"
        job = bench.raw_job(name, tasks, (min(pairing.timeout, CHECK_TIMEOUT),) * len(tasks), decode)
        # One process that workers are forked from, which reads a large description once.
        return list(run_isolated(replace(job, give_up=True, prepared_by=work.__name__)))

    first, second = (2 * limit / 2**protocol.loop.torque_bits for limit in protocol.loop.torque_limit)
    asked = [dynamic.CheckTask(0, pairing.setup, T_s)]
    (rest,) = run(pairing, dynamic.find_rest, asked, lambda _, value: unpack(value, dynamic.RestState))
    yield from failed(dynamic.TIMING_CHECK, rest)
    responses: list[np.ndarray] = []
    if isinstance(rest, Done):
        at = rest.value
        torques: Decode = lambda _, value: unpack(value, np.ndarray)  # noqa: E731
        errors = [(behaviour.step_errors(begin), initially) for begin, initially in behaviour.EXPERIMENTS]
        tasks = [work.AnswerTask(pairing.setup, at.q_m, at.u_m, at.q_a, T_s, *experiment) for experiment in errors]
        # In processes of their own, since nothing is known yet of what a controller leaves behind.
        *_, ended = outcomes = run(replace(pairing, separate=True), work.answer, tasks, torques)
        yield from failed(dynamic.TIMING_CHECK, ended)
        if isinstance(ended, Died) and ended.timeout:  # it would hang in the others as well, and longer
            left = ", ".join(("repeatability", "reset", *(check.subject for check, _ in dynamic.CHECKS), "cost"))
            yield Finding(Severity.NOTE, "check", f"left out after that: {left}", "Mend what hangs, and check again.")
            return
        if isinstance(ended, Done):
            responses = [outcome.value for outcome in outcomes if isinstance(outcome, Done)]
            yield from dynamic.timing(responses, at.u_m, (first, second))
    shown = _carry_over(pairing, cases)
    separated = replace(pairing, separate=shown.separates)
    if isinstance(rest, Done):
        yield from dynamic.carry_over(shown)
    if responses:
        (again,) = run(separated, work.answer, [structs.replace(tasks[behaviour.STEP], after_reset=True)], torques)
        yield from failed(dynamic.RESET_CHECK, again)
        if isinstance(again, Done):
            yield from dynamic.reset(responses[behaviour.STEP], again.value)
    for number, (check, _) in enumerate(dynamic.CHECKS):
        if check.subject == "several instances" and separated.is_separate and not separated.separate:
            continue  # it has declared that it cannot
        task = dynamic.CheckTask(number, separated.setup, T_s)
        for outcome in run(separated, dynamic.run_check, [task], lambda _, value: unpack(value, tuple[Finding, ...])):
            yield from failed(check, outcome)
            if isinstance(outcome, Done):
                yield from outcome.value
    found_time = (
        computing_time(case, separated) if responses else None
    )  # one that cannot be loaded has been told already
    if found_time is not None:
        yield from dynamic.cost(found_time, float(T_s), FULL_LENGTH, pairing.timeout)


def _carry_over(pairing: Pairing, cases: Sequence[Case]) -> CarryOver:
    """Whether state is carried over from ``cases`` to the first one, as a rehearsal shows it."""
    try:
        return rehearse(cases[0], pairing, probe=False, visited=cases[1:]).carry_over
    except (Crash, FmuError, InputError):  # what is wrong, another look says
        return CarryOver.NOT_TESTED


def selftest() -> BitComparison:
    """Simulate the loops of :mod:`~orchestrator.benchmark.bits` and compare their hashes with the published ones.

    What needs a C compiler is skipped where there is none.
    """
    compiler = find_compiler() is not None
    here = [pair for pair in PAIRS if compiler or not pair.compiler]
    skipped = tuple(pair.name for pair in PAIRS if pair not in here)
    tasks = [(pair, id) for pair in here for id in CASES]
    for pair in here:  # built before threads ask for it
        built_in(pair.plant)
        built_in(pair.controller)
    # Threads: each waits for a process of its own, which does the work.
    with ThreadPoolExecutor(available_cores()) as pool:
        hashes = list(pool.map(lambda task: _hash(*task), tasks))
    return BitComparison(
        {f"{pair.name}/{id}": value for (pair, id), value in zip(tasks, hashes, strict=True)}, published(), skipped
    )


def _hash(pair: Pair, id: str) -> str:
    testbed = Testbed(plant=built_in(pair.plant))
    pairing, case = testbed.sampled(Controller.built_in(pair.controller), short_case(id))
    return hash_of(simulate(pairing, case.scenario))
