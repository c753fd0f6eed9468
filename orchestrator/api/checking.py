"""What can be said of a controller FMU before any evaluation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from ..benchmark.protocol import Protocol
from ..codec import unpack
from ..conformance.finding import Finding, Severity
from ..conformance.static import archive_findings, binding_findings, sampling_findings
from ..errors import InputError
from ..execution.job import Died, Refused
from ..execution.supervision import run_isolated
from ..loop.sampling import controller_sample_time
from ..loop.scenario import Scenario
from ..loop.setup import controller_binding
from ..pairing.controller import Controller
from ..pairing.pairing import FULL_LENGTH, Pairing

LONGEST_LOOK = 10.0
"""Processor time [s] that a look at the running controller may take; waiting is limited as well, see
:mod:`~orchestrator.execution.time_limit`."""


def findings(
    controller: Controller, pairing: Callable[[], Pairing], protocol: Protocol, scenario: Scenario
) -> Iterator[Finding]:
    """The findings on ``controller`` as they come; ``pairing`` opens it, its steps are timed in ``scenario``."""
    try:
        opened = pairing()
        archive, setup = opened.controller, opened.setup
        yield from archive_findings(archive)
        yield from binding_findings(controller_binding(archive, setup), archive, setup)
        sample_time = controller_sample_time(archive, protocol.sample_time, controller.given_sample_time)
        yield from sampling_findings(sample_time, protocol.sample_time)
        yield from _dynamic(opened, replace(scenario, sample_time=sample_time.value), protocol)
    except InputError as error:
        yield Finding(Severity.ERROR, "import", str(error), "", error.what, error.value, error.nearest)


def _dynamic(pairing: Pairing, scenario: Scenario, protocol: Protocol) -> Iterator[Finding]:
    from ..conformance import dynamic  # it loads the compiler

    first, second = (2 * limit / 2**protocol.loop.torque_bits for limit in protocol.loop.torque_limit)
    tasks = [
        dynamic.CheckTask(
            number, pairing.setup, scenario.sample_time, (first, second), scenario, FULL_LENGTH, pairing.timeout
        )
        for number in range(len(dynamic.CHECKS))
    ]
    job = pairing.raw_job(
        f"{dynamic.__name__}:{dynamic.run_check.__name__}",
        tasks,
        (min(pairing.timeout, LONGEST_LOOK),) * len(tasks),
        lambda _, value: unpack(value, tuple[Finding, ...]),
    )
    known = ""
    for outcome in run_isolated(job):
        check = dynamic.CHECKS[outcome.index]
        if isinstance(outcome, Refused):
            if outcome.error.message == known:  # it fails before any look begins: once is enough
                continue
            known = outcome.error.message
            remedy = check.loss or "Mend what the FMU says itself, and export it again."
            yield Finding(check.failure, check.subject, known, remedy)
        elif isinstance(outcome, Died):
            text = "\n".join((outcome.message, *outcome.output))
            remedy = check.loss or "Run the FMU in a debugger: it ends or hangs its process."
            yield Finding(check.failure, check.subject, text, remedy)
            if outcome.timeout and (left := dynamic.CHECKS[outcome.index + 1 :]):  # it would hang in the others as well
                text = f"left out after that: {', '.join(other.subject for other in left)}"
                yield Finding(Severity.NOTE, "check", text, "Mend what hangs, and check again.")
                return
        else:
            yield from outcome.value
