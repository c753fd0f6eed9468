"""Tuning a controller: what is searched, what judges the candidates, and what is found out about the best one."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from ..benchmark.protocol import names
from ..benchmark.results import Requirement
from ..documents.commands import simulate_command
from ..documents.head import Head
from ..documents.recording import BESIDE
from ..documents.robustness import Robustness
from ..documents.tuning import Best, Judged, Tuning
from ..documents.wording import reason_text
from ..entry import finite
from ..errors import Crash, FmuError, InputError
from ..pairing.controller import Controller
from ..pairing.testbed import Testbed
from ..search.candidates import Range, Trial, check_range
from ..search.proposals import SAMPLERS, STUDY, Proposals
from ..views.units import amplitude
from .declaration import Study, described, option
from .evaluate import EvaluationStudy, SpreadStudy
from .heads import head
from .requests import Now, OwnFile, Requests, Save, Write, inside, rehearsed
from .tuner import CandidateVerdict, Judge, Tuner, values_of
from .worst_case import RobustnessStudy, sought, worst_case

logger = logging.getLogger(__name__)

SEED_OFFSET = 1234
"""What the objective's seed is above the benchmark's: it has other systems, disturbances and noise."""

HELD_OUT_OFFSETS = range(1, 9)
"""What the seeds of the draws that the best candidate is tried with are above the objective's."""

SEED_OFFSETS = range(1, 4)
"""What the seeds of the whole protocol that it is tried with are above the benchmark's."""

BEST = "best.toml"
"""The best candidate's parameters, as a file of parameters."""


@described
@dataclass(frozen=True)
class TuningStudy(Study[Tuning]):
    """Search for parameters of a controller that make V small while A1 to A3 hold.

    Candidates are tried in a short protocol, and the best of them in the benchmark's own one, again and again: what
    fails there is added to the short one. It needs the packages Optuna and cmaes (the extra ``tuning``).
    """

    command = "tune"
    suffix = "-tuning"

    vary: Mapping[str, Range | tuple[float, float] | tuple[float, float, str]] = option(
        dict,
        "a parameter and its range, in the unit the FMU has for it",
        metavar="NAME=LOW:HIGH[:log]",
        required=True,
    )
    trials: int = option(200, "candidates", least=1, metavar="N")
    objective: str | Path = option(
        "tuning",
        f"the short protocol that candidates are tried in, one of: {', '.join(names())}; or a protocol file; V counts, "
        "and 4 for each factor e by which a limit cycle exceeds what A3 allows",
        metavar="NAME",
    )
    strict: str | Path = option(
        "strict",
        "the protocol whose list the best candidate is tried on, and a search for the worst case begins with",
        asked=False,
    )
    robust: int = option(
        0,
        "search for the worst case of the best candidates, with a budget of so many whole cases each, at least the 936 "
        "of the strict list, and count what is found",
        least=0,
        metavar="N",
    )
    sampler: str = option("cmaes", "of Optuna", choices=SAMPLERS, rare=True)
    search_seed: int = option(1, "of the sampler", least=0, metavar="N", rare=True)

    def ask(self, testbed: Testbed, controller: Controller, folder: Path | None = None) -> Requests[Tuning]:
        """The requests of a tuning; the sampler keeps its own record in the study's folder."""
        short = replace(testbed, protocol=self.objective, seed=testbed.seed + SEED_OFFSET)
        controller, pairing, T_s, cases = short.prepared(controller)
        vary = ranges(self.vary)
        start = values_of(controller, vary)
        measured = {name for case in cases for name in case.test.criteria}
        if absent := [name for name in short.rules.criteria if name not in measured]:
            message = f"The protocol {self.objective} does not measure {', '.join(absent)}: it has no V to tune by."
            raise InputError(message, "no-criteria", self.objective)
        list_of = replace(testbed, protocol=self.strict)
        if self.robust:
            sought(list_of.rules, list_of.prepared(controller)[3], self.robust, ())
        begin_at = {name: bounds.rounded(start[name]) for name, bounds in vary.items()}
        for name, bounds in vary.items():
            if not bounds.low <= start[name] <= bounds.high:
                logger.warning(
                    "%s is %g, out of its range: the search begins at %g.", name, start[name], begin_at[name]
                )

        begin = yield Now()
        yield Write(BEST, None)  # of another search
        proposals = Proposals(vary, begin_at, self.sampler, self.search_seed, (yield OwnFile(STUDY)))
        yield from rehearsed(short.pairing(controller.with_parameters(begin_at)), cases[0])
        tuner = Tuner(
            short.rules,
            lambda values: short.pairing(controller.with_parameters(values)),
            _judge(testbed, controller, self.strict, self.robust),
            proposals,
            list(cases),
        )
        yield from tuner.search(self.trials)
        best = yield from tuner.best()
        best_record = None
        if best is not None:
            # Other seeds than those it was tuned with: a candidate may fit the noise and the arms of its objective.
            draws = {seed: replace(short, seed=short.seed + seed).prepared(controller)[3] for seed in HELD_OUT_OFFSETS}
            held_out = yield from tuner.held_out(best, draws)
            chosen = controller.with_parameters(best.values)
            lines = [f'"{name}" = {value!r}\n' for name, value in best.values.items()]
            yield Write(BEST, "".join(["[parameters]\n", *lines]))
            whole = yield from inside(_name(best), EvaluationStudy(keep_going=True).ask(testbed, chosen))
            others = SpreadStudy([testbed.seed + offset for offset in SEED_OFFSETS], EvaluationStudy(recordings=False))
            seeds = yield from inside("seeds", others.ask(testbed, chosen))
            whole_list = EvaluationStudy(recordings=False, keep_going=True)
            listed = yield from inside("strict", whole_list.ask(list_of, chosen))
            broken = tuple(name for name, entry in listed.requirements.items() if entry.passed is False)
            best_record = Best(
                best, whole.cost, held_out, seeds.cost, listed.cost, broken, _not_judged(listed.requirements)
            )
        end = yield Now()
        tuning = Tuning(
            schema=Tuning.SCHEMA,
            head=head(testbed, controller, pairing, T_s, begin, end),
            objective=str(self.objective),
            sampler=self.sampler,
            search_seed=self.search_seed,
            robust=self.robust,
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
            best=best_record,
            importance=proposals.importance(),
        )
        yield Save(tuning)
        return tuning


def ranges(given: Mapping[str, Range | tuple[float, float] | tuple[float, float, str]]) -> dict[str, Range]:
    """The ranges that are ``given``, as tuples or as they are; raises :class:`InputError` for what is none."""
    checked = {}
    for name, bounds in given.items():
        if not isinstance(bounds, tuple | Range):
            raise InputError(f"The range of {name} must be (LOW, HIGH), not {bounds!r}.", "bad-range", name, bounds)
        low, high, *scale = (
            bounds if isinstance(bounds, tuple) else (bounds.low, bounds.high, *(["log"] if bounds.log else []))
        )
        if scale not in ([], ["log"]):
            message = f'The range of {name} must be (LOW, HIGH) or (LOW, HIGH, "log"), not {bounds}.'
            raise InputError(message, "bad-range", name, bounds)
        checked[name] = check_range(name, Range(finite(name, low), finite(name, high), bool(scale)))
    if not checked:
        raise InputError("Nothing varies: at least one parameter with its range is needed.", "nothing-varies")
    return checked


def _judge(goal: Testbed, controller: Controller, strict: str | Path, robust: int) -> Judge:
    """What tries a candidate on the whole protocol and, with a budget of ``robust`` whole cases, searches for its worst
    case."""

    def verdict(trial: Trial) -> Requests[CandidateVerdict]:
        candidate, folder = controller.with_parameters(trial.values), _name(trial)
        _, _, _, cases = goal.prepared(candidate)
        try:
            whole = EvaluationStudy(recordings=False, keep_going=True)
            evaluation = yield from inside(folder, whole.ask(goal, candidate))
        except FmuError as refusal:  # at a pose that the objective does not have, so from now on it has it
            reason = f"The FMU refused {cases[0].id}: {refusal}"
            return CandidateVerdict(None, None, ("refused",), [(cases[0], "")], (reason,))
        broken = [name for name, entry in evaluation.requirements.items() if entry.passed is False]
        failing = {
            verdict.worst_case: None
            for name in broken
            for _, verdict in evaluation.requirements[name].by_role(name)
            if verdict.passed is False and verdict.worst_case
        }
        named = {case.id: case for case in cases}
        counterexamples = [(named[id], simulate_command(evaluation.head, id)) for id in failing]
        broken += [f"{name} not judged" for name in _not_judged(evaluation.requirements)]
        if evaluation.cost is None:
            broken.append("V")
        if not robust or broken:  # a search finds nothing that would make it hold
            reasons = failure_reasons(evaluation.head, evaluation.requirements)
            return CandidateVerdict(evaluation.cost, None, tuple(broken), counterexamples, reasons)
        try:
            search = RobustnessStudy(budget=robust, protocol=strict, recordings=False)
            answer, shown = yield from inside(folder, worst_case(goal, candidate, search))
        except (FmuError, Crash) as refusal:
            ended = f"The search for the worst case ended: {refusal}"
            return CandidateVerdict(evaluation.cost, None, ("refused in strict",), counterexamples, (ended,))
        for to_show in shown:
            commands = [_command(answer, role) for role in to_show.roles if not role.startswith(BESIDE)]
            counterexamples += [(to_show.case, command) for command in commands[:1] if command]
        unknown = (f"{name} not judged" for name, entry in answer.requirements.items() if entry.passed is None)
        told = (
            f"{name} fails in a search for the worst case: {answer.requirements[name].kind}" for name in answer.broken
        )
        return CandidateVerdict(evaluation.cost, answer.cost, (*answer.broken, *unknown), counterexamples, tuple(told))

    return verdict


def failure_reasons(head: Head, requirements: Mapping[str, Requirement]) -> tuple[str, ...]:
    """Why requirements are not met or not judged in the protocol, with the worst limit cycle and its ratio to what A3
    allows."""
    told, allowed = [], head.rules.stability.limit_cycle
    for name, entry in requirements.items():
        if entry.passed or not entry.tally.cases:
            continue
        text = reason_text(name, entry.passed, f"in {head.protocol}", entry.reason)
        if entry.passed is False and entry.limit_cycle is not None:
            text += f", {amplitude(entry.limit_cycle)}, {entry.limit_cycle / allowed:.3g} times what is allowed"
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
