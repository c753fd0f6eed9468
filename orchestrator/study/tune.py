"""Tuning a controller: what is searched, what judges the candidates, and what is found out about the best one."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ..benchmark.results import Requirement
from ..documents.commands import simulate_command
from ..documents.head import Head
from ..documents.reasons import reason_text
from ..documents.recording import BESIDE
from ..documents.robustness import Robustness
from ..documents.tuning import Best, Judged, Tuning
from ..entry import finite
from ..errors import Crash, FmuError, InputError
from ..pairing.controller import Controller
from ..pairing.testbed import Testbed
from ..search.candidates import Range, Trial, check_range
from ..search.proposals import Proposals
from .candidates import values_of
from .evaluate import evaluate, spread
from .heads import head
from .requests import Now, Save, Study, Write, rehearsed
from .tuner import Judge, Tuner, Verdict
from .worst_case import sought, worst_case

logger = logging.getLogger(__name__)

SEED = 1234
"""What the objective's seed is above the benchmark's: it has other systems, disturbances and noise."""

HELD_OUT = range(1, 9)
"""What the seeds of the draws that the best candidate is tried with are above the objective's."""

SEEDS = range(1, 4)
"""What the seeds of the whole protocol that it is tried with are above the benchmark's."""

BEST = "best.toml"
"""The best candidate's parameters, as a file of parameters."""


def tune(
    goal: Testbed,
    controller: Controller,
    given: Mapping[str, Range | tuple[float, float] | tuple[float, float, str]],
    objective: str | Path,
    strict: str | Path,
    trials: int,
    robust: int,
    sampler: str,
    search_seed: int,
    record: Path | None,
) -> Study[Tuning]:
    """See :meth:`.Benchmark.tune`; ``record`` is the file of the sampler's own record, if there is to be one."""
    short = replace(goal, protocol=objective, seed=goal.seed + SEED)
    controller, pairing, T_s, cases = short.prepared(controller)
    vary = ranges(given)
    start = values_of(controller, vary)
    if trials < 1:
        raise InputError("At least one trial is needed.", "bad-number")
    if not any(case.test.criteria for case in cases):
        raise InputError(f"The protocol {objective} has no test that V is measured in.", "no-criteria", objective)
    list_of = replace(goal, protocol=strict)
    if robust:
        sought(list_of.rules, list_of.prepared(controller)[3], robust, ())
    begin_at = {name: own.rounded(start[name]) for name, own in vary.items()}
    for name, own in vary.items():
        if not own.low <= start[name] <= own.high:
            logger.warning("%s is %g, out of its range: the search begins at %g.", name, start[name], begin_at[name])

    begin = yield Now()
    yield Write(BEST, None)  # of another search
    proposals = Proposals(vary, begin_at, sampler, search_seed, record)
    yield from rehearsed(short.pairing(controller.with_parameters(begin_at)), cases[0])
    tuner = Tuner(
        short.rules,
        lambda values: short.pairing(controller.with_parameters(values)),
        _judge(goal, controller, strict, robust),
        proposals,
        list(cases),
    )
    yield from tuner.search(trials)
    best = yield from tuner.best()
    found = None
    if best is not None:
        draws = {seed: replace(short, seed=short.seed + seed).prepared(controller)[3] for seed in HELD_OUT}
        held_out = yield from tuner.held_out(best, draws)
        chosen = controller.with_parameters(best.values)
        lines = [f'"{name}" = {value!r}\n' for name, value in best.values.items()]
        yield Write(BEST, "".join(["[parameters]\n", *lines]))
        whole = yield from evaluate(goal, chosen, inside=_name(best), keep_going=True)
        others = [goal.seed + each for each in SEEDS]
        seeds = yield from spread(goal, chosen, others, inside="seeds", recordings=False)
        listed = yield from evaluate(list_of, chosen, inside="strict", recordings=False, keep_going=True)
        broken = tuple(name for name, entry in listed.requirements.items() if entry.passed is False)
        found = Best(best, whole.cost, held_out, seeds.cost, listed.cost, broken, _not_judged(listed.requirements))
    end = yield Now()
    tuning = Tuning(
        schema=Tuning.SCHEMA,
        head=head(goal, controller, pairing, T_s, begin, end),
        objective=str(objective),
        sampler=sampler,
        search_seed=search_seed,
        robust=robust,
        vary=vary,
        trials=tuple(tuner.trials),
        judged=tuple(
            Judged(
                number,
                after,
                verdict.cost,
                verdict.worst_cost,
                verdict.broken,
                tuple(line for _, line in verdict.counterexamples),
                verdict.reasons,
            )
            for number, (after, verdict) in tuner.judged.items()
        ),
        best=found,
        importance=proposals.importance(),
    )
    yield Save(tuning)
    return tuning


def ranges(given: Mapping[str, Range | tuple[float, float] | tuple[float, float, str]]) -> dict[str, Range]:
    """The ranges that are ``given``, as tuples or as they are; raises :class:`InputError` for what is none."""
    found = {}
    for name, own in given.items():
        if not isinstance(own, tuple | Range):
            raise InputError(f"The range of {name} must be (LOW, HIGH), not {own!r}.", "bad-range", name, own)
        low, high, *scale = own if isinstance(own, tuple) else (own.low, own.high, *(["log"] if own.log else []))
        if scale not in ([], ["log"]):
            message = f'The range of {name} must be (LOW, HIGH) or (LOW, HIGH, "log"), not {own}.'
            raise InputError(message, "bad-range", name, own)
        found[name] = check_range(name, Range(finite(name, low), finite(name, high), bool(scale)))
    if not found:
        raise InputError("Nothing varies: at least one parameter with its range is needed.", "nothing-varies")
    return found


def _judge(goal: Testbed, controller: Controller, strict: str | Path, robust: int) -> Judge:
    """What tries a candidate on the whole protocol and, with a budget of ``robust`` whole cases, searches for its worst
    case."""

    def verdict(trial: Trial) -> Study[Verdict]:
        candidate, own = controller.with_parameters(trial.values), _name(trial)
        _, _, _, cases = goal.prepared(candidate)
        try:
            evaluation = yield from evaluate(goal, candidate, inside=own, recordings=False, keep_going=True)
        except FmuError as refusal:  # at a pose that the objective does not have, so from now on it has it
            return Verdict(None, None, ("refused",), [(cases[0], "")], (f"The FMU refused {cases[0].id}: {refusal}",))
        broken = [name for name, entry in evaluation.requirements.items() if entry.passed is False]
        failing = {
            verdict.worst_case: None
            for name in broken
            for verdict in evaluation.requirements[name].axes.values()
            if verdict.passed is False and verdict.worst_case
        }
        named = {case.id: case for case in cases}
        found = [(named[id], simulate_command(evaluation.head, id)) for id in failing]
        broken += [f"{name} not judged" for name in _not_judged(evaluation.requirements)]
        if evaluation.cost is None:
            broken.append("V")
        if not robust or broken:  # a search finds nothing that would make it hold
            reasons = failure_reasons(evaluation.head, evaluation.requirements)
            return Verdict(evaluation.cost, None, tuple(broken), found, reasons)
        try:
            answer, shown = yield from worst_case(goal, candidate, robust, protocol=strict, inside=own)
        except (FmuError, Crash) as refusal:
            ended = f"The search for the worst case ended: {refusal}"
            return Verdict(evaluation.cost, None, ("refused in strict",), found, (ended,))
        for each in shown:
            commands = [_command(answer, role) for role in each.roles if not role.startswith(BESIDE)]
            found += [(each.case, command) for command in commands[:1] if command]
        unknown = (f"{name} not judged" for name, entry in answer.requirements.items() if entry.passed is None)
        told = (
            f"{name} fails in a search for the worst case: {answer.requirements[name].kind}" for name in answer.broken
        )
        return Verdict(evaluation.cost, answer.cost, (*answer.broken, *unknown), found, tuple(told))

    return verdict


def failure_reasons(own: Head, requirements: Mapping[str, Requirement]) -> tuple[str, ...]:
    """Why requirements are not met or not judged in the protocol, with the worst limit cycle and its ratio to what A3
    allows."""
    told, allowed = [], own.rules.stability.limit_cycle
    for name, entry in requirements.items():
        if entry.passed or not entry.tally.cases:
            continue
        text = reason_text(name, entry.passed, f"in {own.protocol}", entry.reason)
        if entry.passed is False and entry.limit_cycle is not None:
            text += f", {1e6 * entry.limit_cycle:.3g} µm, {entry.limit_cycle / allowed:.3g} times what is allowed"
        told.append(text)
    return tuple(told)


def _not_judged(requirements: Mapping[str, Requirement]) -> tuple[str, ...]:
    """The requirements that the protocol has cases for, but that are not judged."""
    return tuple(name for name, entry in requirements.items() if entry.passed is None and entry.tally.cases)


def _command(answer: Robustness, role: str) -> str:
    """The command that repeats the worst case of a criterion, or of a requirement that fails; else nothing."""
    if role in answer.criteria:
        return answer.criteria[role].worst_case.command
    entry = answer.requirements[role[:2]]
    return entry.command if entry.passed is False else ""


def _name(trial: Trial) -> str:
    """The folder of a candidate that is tried on the whole protocol."""
    return f"trial-{trial.number}"
