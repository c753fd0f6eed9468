"""Verifying a controller: draws that nobody knew before, the controller in a process of its own, and references."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

from msgspec import structs

from ..benchmark import protocol as protocols
from ..benchmark.case import Case
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
from ..pairing.runs import CaseRun
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
    controller may have seen its draws. It is begun again with others, and the certificate counts that. With the draws
    of a round it is not: a controller that ends its own process could so choose among draws.
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
                # With other draws: those that a controller has seen, it could be prepared for. In a round, all have the
                # same ones: a PID that killed itself at poses it disliked came before the same PID that did not.
                if problem.what != NOT_BY_CONTROLLER or drawn.source == "round" or repetition == ATTEMPTS - 1:
                    raise
                logger.warning("%s The verification begins again, with other draws.", problem)
        raise AssertionError("the last attempt raises or returns")


@dataclass(frozen=True)
class Listed:
    """The cases of a ``protocol`` in each draw, with its seed, and the ``order`` in which all of them are run."""

    protocol: Protocol
    draws: tuple[tuple[int, tuple[Case, ...]], ...]
    order: tuple[int, ...]

    @classmethod
    def of(
        cls, protocol: Protocol, nominal: Mapping[str, float], seeds: Sequence[int], T_s: Fraction | None, entropy: str
    ) -> Listed:
        """The cases for the ``seeds``, at the sample time [s] of a controller if it is another one's."""
        draws = tuple((seed, cases(protocol, nominal, seed, T_s)) for seed in seeds)
        return cls(protocol, draws, tuple(mixed(entropy, sum(len(drawn) for _, drawn in draws))))

    def entry(self, pairing: Pairing, failure: CaseRun | None = None) -> BatchEntry:
        """What asks for the runs with a ``pairing``."""
        listing = [case for _, drawn in self.draws for case in drawn]
        in_order = tuple(listing[place] for place in self.order)
        return BatchEntry(self.protocol, pairing, in_order, first_sample_failure=failure)

    def by_draw(self, runs: Sequence[CaseRun]) -> list[tuple[int, list[CaseResult]]]:
        """The results of each draw, with its seed, of the ``runs`` of the entry."""
        by_place = dict(zip(self.order, runs, strict=True))
        results = (by_place[place].result for place in range(len(runs)))
        return [(seed, [next(results) for _ in drawn]) for seed, drawn in self.draws]


def drawn_results(listed: Sequence[Listed], runs: Sequence[Sequence[CaseRun]]) -> DrawnResults:
    """What the ``runs`` of each list came to: the first one is of all draws, one behind it of the worst poses."""
    asked = [rules(one.protocol) for one in listed]
    by_draw = [one.by_draw(of_one) for one, of_one in zip(listed, runs, strict=True)]
    result, *worst = map(overall, asked, by_draw)
    return DrawnResults(
        **structs.asdict(result),
        draws=tuple(Draw(seed, score(asked[0], results).cost, digest(results)) for seed, results in by_draw[0]),
        strict=worst[0] if worst else None,
    )


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
    protocol = testbed.rules
    T_s = controller_sample_time(isolated.controller, protocol.sample_time, controller.given_sample_time).value
    drawn = seeds(entropy, isolated.controller.sha256, count, repetition)
    begin = yield Now()
    # Of another seed than the draws, of which it would show something.
    rehearsal = yield Rehearse(isolated, cases(protocol, testbed.nominal, 0, T_s)[0], probe=False)
    asked = [(protocol, drawn), *([(protocols.load(STRICT), drawn[:1])] if strict else [])]

    def listed(interval: Fraction | None) -> list[Listed]:
        return [Listed.of(one, testbed.nominal, chosen, interval, entropy.value) for one, chosen in asked]

    lists, common, witness = listed(T_s), listed(None), Witness(protocol, isolated.controller.name, testbed.nominal)
    length = sum(len(one.order) for one in lists)
    total = (1 + len(others)) * length
    first, *more = (one.entry(isolated, rehearsal.failure) for one in lists)
    result = drawn_results(lists, (yield Batch((replace(first, witness=witness), *more), 0, total)))
    checked, references = (yield from check(witness)), {}
    for number, (name, pairing) in enumerate(others.items(), 1):
        runs = yield Batch(tuple(one.entry(pairing) for one in common), number * length, total)
        references[name] = Reference(**structs.asdict(drawn_results(common, runs)), file=pairing.controller.name)
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
