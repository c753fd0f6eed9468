"""Verifying a controller: draws that nobody knew before, in a process that it cannot reach, beside references."""

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

from msgspec import structs

from ..benchmark import protocol as protocols
from ..benchmark.cases import cases
from ..benchmark.certificate import Draw, Reference, Tried, digest, identity, overall, seeds
from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult, rules
from ..benchmark.scorecard import score
from ..cache import code_hash
from ..errors import InputError
from ..execution import pool, sandbox, store
from ..loop.sampling import controller_sample_time
from ..reporting.certificates import FRESH, PUBLISHED, STRICT, Verification
from . import document
from .campaign import Bench, CaseRun, rehearse
from .conditions import Conditions
from .controller import Controller
from .reference import reference
from .running import Runner

OnCase = Callable[[CaseResult, int, int], None]

logger = logging.getLogger(__name__)


def verify(
    benchmark: Conditions,
    controller: Controller,
    entropy: str | None,
    count: int,
    strict: bool,
    beside: Sequence[str],
    on_result: OnCase | None,
) -> Verification:
    """See :meth:`.benchmark.Benchmark.verify`; the protocol is that of ``benchmark``."""
    start, begin = datetime.now(timezone.utc), time.perf_counter()
    own = replace(benchmark.bench(controller), apart=True, sandbox=benchmark.sandbox or _can_fence())
    others = {name: replace(benchmark.bench(reference(name)), sandbox=False) for name in beside}
    protocol, listed = benchmark.rules, protocols.load(STRICT) if strict else None
    T_s = controller_sample_time(own.controller, protocol.sample_time, controller.given_sample_time).value
    source, text = (FRESH, secrets.token_hex(32)) if entropy is None else (PUBLISHED, entropy)
    setup = own.setup
    drawn = seeds(text, identity(own.controller.sha256, setup.parameters, setup.mapping, float(T_s)), count)
    at_once = rehearse(cases(protocol, benchmark.nominal, drawn[0], T_s)[0], own, probe=False).failure
    each = count * protocol.case_count + (listed.case_count if listed else 0)
    done, total = itertools.count(1), (1 + len(others)) * each

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

    def tried(bench: Bench) -> Tried:
        found, known = run(protocol, bench, drawn), rules(protocol)
        return Tried(
            **structs.asdict(overall(known, found)),
            draws=tuple(Draw(seed, score(known, results).cost, digest(results)) for seed, results in found),
            strict=overall(rules(listed), run(listed, bench, drawn[:1])) if listed else None,
        )

    return Verification(
        **structs.asdict(tried(own)),
        references={
            name: Reference(**structs.asdict(tried(bench)), file=bench.controller.name)
            for name, bench in others.items()
        },
        schema=Verification.SCHEMA,
        benchmark=protocol.benchmark,
        protocol=str(benchmark.protocol),
        source=source,
        entropy=text,
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
    benchmark: Conditions, certificate: Verification, file: Path | None, on_result: OnCase | None
) -> Verification:
    """See :meth:`.benchmark.Benchmark.repeat`."""
    record = certificate.controller
    controller = Controller(file, record.parameters, record.mapping, certificate.sample_time)
    if controller.archive.sha256 != record.sha256:
        message = f"{controller.archive.name} is not the controller of the certificate: its contents differ."
        raise InputError(message, "other-controller", file)
    same = replace(benchmark, protocol=certificate.protocol, plant_parameters=certificate.plant.parameters)
    wanted = (len(certificate.draws), certificate.strict is not None, tuple(certificate.references))
    found = verify(same, controller, certificate.entropy, *wanted, on_result)
    return structs.replace(found, source=certificate.source)


def _can_fence() -> bool:
    """Whether there is a sandbox here; a note says if not."""
    try:
        sandbox.command(())
    except InputError as problem:
        logger.warning("The controller runs without a sandbox, and could reach what you can. %s", problem)
        return False
    return True
