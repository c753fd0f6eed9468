"""Verifying a controller: draws that nobody knew before, in a process that it cannot reach, beside a reference."""

from __future__ import annotations

import itertools
import logging
import secrets
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import structs

from build_fmus import find_compiler

from ..benchmark import protocol as protocols
from ..benchmark.cases import cases
from ..benchmark.certificate import FRESH, PUBLISHED, SCHEMA, Draw, Verification, digest, identity, overall, seeds
from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult, rules
from ..benchmark.scorecard import score
from ..cache import code_hash
from ..errors import InputError
from ..execution import pool, sandbox, store
from ..loop.sampling import controller_sample_time
from . import document
from .built_in import DEFAULT_CONTROLLER
from .campaign import Bench, CaseRun, rehearse
from .controller import Controller
from .running import Runner

if TYPE_CHECKING:
    from .benchmark import Benchmark

DRAWS = 3
STRICT = "strict-verification"

OnCase = Callable[[CaseResult, int, int], None]

logger = logging.getLogger(__name__)


def verify(
    benchmark: Benchmark,
    controller: Controller,
    entropy: str | None,
    count: int,
    strict: bool,
    on_result: OnCase | None,
) -> Verification:
    """See :meth:`.benchmark.Benchmark.verify`; the protocol is that of ``benchmark``."""
    start, begin = datetime.now(timezone.utc), time.perf_counter()
    own = replace(benchmark.bench(controller), apart=True, sandbox=benchmark.sandbox or _can_fence())
    reference = replace(benchmark.bench(Controller.built_in(_reference())), sandbox=False)
    protocol, listed = benchmark.rules, protocols.load(STRICT)
    T_s = controller_sample_time(own.controller, protocol.sample_time, controller.given_sample_time).value
    source, text = (FRESH, secrets.token_hex(32)) if entropy is None else (PUBLISHED, entropy)
    setup = own.setup
    drawn = seeds(text, identity(own.controller.sha256, setup.parameters, setup.mapping, float(T_s)), count)
    at_once = rehearse(cases(protocol, benchmark.nominal, drawn[0], T_s)[0], own).failure
    done, total = itertools.count(1), 2 * count * protocol.case_count + strict * listed.case_count

    def told(run: CaseRun, _done: int, _total: int) -> None:
        if on_result is not None:
            on_result(run.result, next(done), total)

    def run(asked: Protocol, bench: Bench, chosen: Sequence[int]) -> list[tuple[int, list[CaseResult]]]:
        """The results of each draw, with its seed."""
        interval = T_s if bench is own else None
        lists = [cases(asked, benchmark.nominal, seed, interval) for seed in chosen]
        with store.opened(None) as unknown:
            runner = Runner(asked, bench, partial(pool.run, workers=benchmark.processes), unknown)
            failure = at_once if bench is own else None
            runs = iter(runner.run([case for draw in lists for case in draw], failure, on_run=told))
            return [(seed, [next(runs).result for _ in draw]) for seed, draw in zip(chosen, lists, strict=True)]

    mine, theirs = run(protocol, own, drawn), run(protocol, reference, drawn)
    known, score_of = rules(protocol), partial(score, rules(protocol))
    card = overall(known, mine)
    return Verification(
        complete=card.complete,
        cost=card.cost,
        criteria=card.criteria,
        requirements=card.requirements,
        schema=SCHEMA,
        benchmark=protocol.benchmark,
        protocol=str(benchmark.protocol),
        source=source,
        entropy=text,
        draws=tuple(
            Draw(seed, score_of(one).cost, score_of(two).cost, digest(one), digest(two))
            for (seed, one), (_, two) in zip(mine, theirs, strict=True)
        ),
        reference=overall(known, theirs),
        strict=overall(rules(listed), run(listed, own, drawn[:1])) if strict else None,
        controller=document.controller_record(own, controller),
        sample_time=float(T_s),
        plant=document.plant_record(benchmark.manipulator, benchmark.plant_parameters),
        code=code_hash(),
        sandbox=own.sandbox,
        environment=document.environment(),
        start=start.isoformat(timespec="seconds"),
        wall_time=time.perf_counter() - begin,
    )


def repeat(
    benchmark: Benchmark, certificate: Verification, file: Path | None, on_result: OnCase | None
) -> Verification:
    """See :meth:`.benchmark.Benchmark.repeat`."""
    record = certificate.controller
    controller = Controller(file, record.parameters, record.mapping, certificate.sample_time)
    if controller.archive.sha256 != record.sha256:
        message = f"{controller.archive.name} is not the controller of the certificate: its contents differ."
        raise InputError(message, "other-controller", file)
    same = replace(benchmark, protocol=certificate.protocol, plant_parameters=certificate.plant.parameters)
    found = verify(
        same, controller, certificate.entropy, len(certificate.draws), certificate.strict is not None, on_result
    )
    return structs.replace(found, source=certificate.source)


def _reference() -> str:
    """The paper's PID, which gives the same bits in C and in Python."""
    return f"{DEFAULT_CONTROLLER}_C" if find_compiler() is not None else DEFAULT_CONTROLLER


def _can_fence() -> bool:
    """Whether there is a sandbox here; a note says if not."""
    try:
        sandbox.command(())
    except InputError as problem:
        logger.warning("The controller runs without a sandbox, and could reach what you can. %s", problem)
        return False
    return True
