"""Verifying a controller: draws that nobody knew before, the controller in a process of its own, and references."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from msgspec import structs

from ..benchmark import protocol as protocols
from ..benchmark.cases import cases
from ..benchmark.certificate import Draw, DrawnResults, Reference, digest, overall, seeds
from ..benchmark.draws import Entropy, fresh
from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult, rules
from ..benchmark.scorecard import score
from ..cache import code_hash
from ..documents.verification import COUNT, PROTOCOL, STRICT, USUAL, Verification
from ..errors import EnvironmentFault, InputError
from ..execution.interpreter import is_clean
from ..execution.supervision import NOT_BY_CONTROLLER
from ..fmi.library import WINE
from ..loop.sampling import controller_sample_time
from ..loop.setup import effective
from ..pairing.controller import IN_C, Controller, reference
from ..pairing.pairing import Pairing
from ..pairing.testbed import Testbed
from . import engine
from .declaration import Study, described, option
from .heads import head
from .requests import Batch, BatchEntry, Now, Rehearse, Requests
from .witness import Witness, check

logger = logging.getLogger(__name__)

ATTEMPTS = 3
"""Verifications that faults from outside may cost before that is given up."""


@described
@dataclass(frozen=True)
class VerificationStudy(Study[Verification]):
    """Evaluate where the controller can reach neither judge nor draws: the result one can trust.

    The controller runs in a new process for each simulation, in the sandbox where there is one; plant, noise and
    judge are in a process that never loads it. The draws are made after its FMU has been read. It runs on this
    machine, and nothing is written.

    What comes from outside, such as a process that somebody else ends, ends a verification without a result: the
    controller may have seen its draws. It is begun again with others, and the certificate counts that.
    """

    command = "verify"
    protocol_option = "protocol"
    on_this_machine = True

    draws: Entropy | None = option(
        None,
        "what the draws follow from: :func:`~orchestrator.benchmark.draws.from_beacon` gives the bits of a public "
        "beacon; fresh ones of this machine by default",
        asked=False,
    )
    count: int = option(COUNT, "number of draws", least=1, asked=False)
    strict: bool = option(
        True,
        "whether to run the worst poses of the protocol strict as well, moved by the first draw",
        off="leave out the worst poses of the protocol strict, which are 108 of 318 simulations per controller",
    )
    beside: Sequence[str] = option(USUAL, "references beside the controller", choices=(*IN_C,), asked=False)
    protocol: str | Path = option(PROTOCOL, "what is run once per draw", asked=False)

    def ask(self, testbed: Testbed, controller: Controller, folder: Path | None = None) -> Requests[Verification]:
        """The requests of a verification."""
        same, sandboxed = replace(testbed, protocol=self.protocol), testbed.sandbox or engine.can_fence()
        drawn = self.draws or fresh()
        for repetition in range(ATTEMPTS):
            try:
                options = self.count, self.strict, tuple(self.beside), sandboxed
                return (yield from _verified(same, controller, drawn, repetition, *options))
            except EnvironmentFault as problem:
                # With other draws: those that a controller has seen, it could be prepared for.
                if problem.what != NOT_BY_CONTROLLER or repetition == ATTEMPTS - 1:
                    raise
                logger.warning("%s The verification begins again, with other draws.", problem)
        raise AssertionError("the last attempt raises or returns")


def _verified(
    testbed: Testbed,
    controller: Controller,
    entropy: Entropy,
    repetition: int,
    count: int,
    strict: bool,
    beside: Sequence[str],
    sandboxed: bool,
) -> Requests[Verification]:
    paired = testbed.pairing(controller)
    # In the one form that all spellings of a setting share: how it is spelled must not change what the FMU is told.
    isolated = replace(paired, setup=effective(paired.controller, paired.setup), isolated=True, sandbox=sandboxed)
    # Without a sandbox: the references are the benchmark's own, and nobody chose them for these draws.
    others = {name: replace(testbed.pairing(reference(name)), sandbox=False) for name in beside}
    protocol, listed = testbed.rules, protocols.load(STRICT) if strict else None
    T_s = controller_sample_time(isolated.controller, protocol.sample_time, controller.given_sample_time).value
    drawn = seeds(entropy.value, isolated.controller.sha256, count, repetition)
    begin = yield Now()
    # Of another seed than the draws, of which it would show something.
    rehearsal = yield Rehearse(isolated, cases(protocol, testbed.nominal, 0, T_s)[0], probe=False)
    total = (1 + len(others)) * (count * protocol.case_count + (listed.case_count if listed else 0))
    done = 0
    witness = Witness(protocol, isolated.controller.name, testbed.nominal)

    def run(asked: Protocol, pairing: Pairing, chosen: Sequence[int]) -> Requests[list[tuple[int, list[CaseResult]]]]:
        """The results of each draw, with its seed."""
        nonlocal done
        interval, failure = (T_s, rehearsal.failure) if pairing is isolated else (None, None)
        lists = [cases(asked, testbed.nominal, seed, interval) for seed in chosen]
        listing = [case for draw in lists for case in draw]
        order = mixed(entropy.value, len(listing))
        in_order = tuple(listing[place] for place in order)
        look = witness if pairing is isolated and asked is protocol else None
        entry = BatchEntry(asked, pairing, in_order, first_sample_failure=failure, witness=look)
        (runs,) = yield Batch((entry,), done, total)
        done += len(runs)
        by_place = dict(zip(order, runs, strict=True))
        results = (by_place[place].result for place in range(len(listing)))
        return [(seed, [next(results) for _ in draw]) for seed, draw in zip(chosen, lists, strict=True)]

    def tried(pairing: Pairing) -> Requests[DrawnResults]:
        by_seed, protocol_rules = (yield from run(protocol, pairing, drawn)), rules(protocol)
        worst = (yield from run(listed, pairing, drawn[:1])) if listed else None
        return DrawnResults(
            **structs.asdict(overall(protocol_rules, by_seed)),
            draws=tuple(Draw(seed, score(protocol_rules, results).cost, digest(results)) for seed, results in by_seed),
            strict=overall(rules(listed), worst) if listed and worst else None,
        )

    result, references = (yield from tried(isolated)), {}
    checked = yield from check(witness)
    for name, pairing in others.items():
        reference_results = yield from tried(pairing)
        references[name] = Reference(**structs.asdict(reference_results), file=pairing.controller.name)
    end = yield Now()
    return Verification(
        **structs.asdict(result),
        references=references,
        schema=Verification.SCHEMA,
        head=head(testbed, controller, isolated, T_s, begin, end),
        entropy=entropy,
        repetitions=repetition,
        code=code_hash(),
        sandbox=isolated.sandbox,
        clean=is_clean(),
        checked=checked,
    )


def mixed(entropy: str, count: int) -> list[int]:
    """An order of ``count`` cases that follows from the ``entropy``: in the listed one, a controller that finds out how
    many cases there were before, or when it is started, would know which test it is in."""
    return sorted(range(count), key=lambda place: hashlib.sha256(f"{entropy}\norder {place}".encode()).digest())


def repeat(testbed: Testbed, certificate: Verification, file: Path | None) -> Requests[Verification]:
    """See :meth:`.Benchmark.repeat`."""
    record = certificate.controller
    library = record.library if record.library == WINE else None
    controller = Controller(file, record.parameters, record.mapping, certificate.sample_time.seconds, library)
    if controller.archive.sha256 != record.sha256:
        message = f"{controller.archive.name} is not the controller of the certificate: its contents differ."
        raise InputError(message, "other-controller", file)
    same = replace(
        testbed,
        protocol=certificate.head.protocol_file or certificate.protocol,
        plant_parameters=certificate.plant.parameters,
    )
    options = (len(certificate.draws), certificate.strict is not None, tuple(certificate.references))
    return (
        yield from _verified(
            same,
            controller,
            certificate.entropy,
            certificate.repetitions,
            *options,
            testbed.sandbox or engine.can_fence(),
        )
    )
