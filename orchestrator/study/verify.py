"""Verifying a controller: draws that nobody knew before, in a process that it cannot reach, beside references."""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from msgspec import structs

from ..benchmark import protocol as protocols
from ..benchmark.cases import cases
from ..benchmark.certificate import Draw, Reference, Tried, digest, identity, overall, seeds
from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult, rules
from ..benchmark.scorecard import score
from ..cache import code_hash
from ..documents.verification import FRESH, PUBLISHED, STRICT, Verification
from ..errors import InputError
from ..loop.sampling import controller_sample_time
from ..pairing.controller import Controller
from ..pairing.pairing import Pairing
from ..pairing.reference import reference
from ..pairing.testbed import Testbed
from .heads import head
from .requests import Batch, Entry, Now, Rehearse, Study


def verify(
    testbed: Testbed,
    controller: Controller,
    entropy: str | None,
    count: int,
    strict: bool,
    beside: Sequence[str],
    sandboxed: bool,
) -> Study[Verification]:
    """See :meth:`.Benchmark.verify`; the protocol is that of ``testbed``, the controller may run ``sandboxed``."""
    own = replace(testbed.pairing(controller), isolated=True, sandbox=sandboxed)
    others = {name: replace(testbed.pairing(reference(name)), sandbox=False) for name in beside}
    protocol, listed = testbed.rules, protocols.load(STRICT) if strict else None
    T_s = controller_sample_time(own.controller, protocol.sample_time, controller.given_sample_time).value
    source, text = (FRESH, secrets.token_hex(32)) if entropy is None else (PUBLISHED, entropy)
    setup = own.setup
    drawn = seeds(text, identity(own.controller.sha256, setup.parameters, setup.mapping, float(T_s)), count)
    begin = yield Now()
    rehearsal = yield Rehearse(own, cases(protocol, testbed.nominal, drawn[0], T_s)[0], probe=False)
    total = (1 + len(others)) * (count * protocol.case_count + (listed.case_count if listed else 0))
    done = 0

    def run(asked: Protocol, pairing: Pairing, chosen: Sequence[int]) -> Study[list[tuple[int, list[CaseResult]]]]:
        """The results of each draw, with its seed."""
        nonlocal done
        interval, failure = (T_s, rehearsal.failure) if pairing is own else (None, None)
        lists = [cases(asked, testbed.nominal, seed, interval) for seed in chosen]
        entry = Entry(asked, pairing, tuple(case for draw in lists for case in draw), at_once=failure)
        (runs,) = yield Batch((entry,), done, total)
        done += len(runs)
        results = iter(runs)
        return [(seed, [next(results).result for _ in draw]) for seed, draw in zip(chosen, lists, strict=True)]

    def tried(pairing: Pairing) -> Study[Tried]:
        found, known = (yield from run(protocol, pairing, drawn)), rules(protocol)
        worst = (yield from run(listed, pairing, drawn[:1])) if listed else None
        return Tried(
            **structs.asdict(overall(known, found)),
            draws=tuple(Draw(seed, score(known, results).cost, digest(results)) for seed, results in found),
            strict=overall(rules(listed), worst) if listed and worst else None,
        )

    result, references = (yield from tried(own)), {}
    for name, pairing in others.items():
        found = yield from tried(pairing)
        references[name] = Reference(**structs.asdict(found), file=pairing.controller.name)
    end = yield Now()
    return Verification(
        **structs.asdict(result),
        references=references,
        schema=Verification.SCHEMA,
        head=head(testbed, controller, own, T_s, begin, end),
        source=source,
        entropy=text,
        code=code_hash(),
        sandbox=own.sandbox,
    )


def repeat(testbed: Testbed, certificate: Verification, file: Path | None, sandboxed: bool) -> Study[Verification]:
    """See :meth:`.Benchmark.repeat`."""
    record = certificate.controller
    controller = Controller(file, record.parameters, record.mapping, certificate.sample_time.seconds)
    if controller.archive.sha256 != record.sha256:
        message = f"{controller.archive.name} is not the controller of the certificate: its contents differ."
        raise InputError(message, "other-controller", file)
    same = replace(
        testbed,
        protocol=certificate.head.protocol_file or certificate.protocol,
        plant_parameters=certificate.plant.parameters,
    )
    wanted = (len(certificate.draws), certificate.strict is not None, tuple(certificate.references))
    found = yield from verify(same, controller, certificate.entropy, *wanted, sandboxed)
    return structs.replace(found, source=certificate.source)
