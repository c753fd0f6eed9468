"""The published numbers, pinned: what every change leaves as it is, or changes with a line in the CHANGELOG.

``tests/golden`` holds

- the rows of ``cases.csv`` to the last bit, for the protocol ``quick``, one configuration of ``paper`` and one of
  ``strict``;
- the numbers of two small searches for the worst case, of a small tuning and of a small certificate, picked from the
  objects by the functions below and not copied from their documents: a document may get another form, its numbers stay;
- the hashes of what the whole leaderboard is computed from: the FMUs' bytes and the cases.

The rows are those of ``flexible-manipulator evaluate NAME.fmu --quick``, of ``--only 'c07.*'`` and of ``--protocol
strict --only 'c00.*'``. ``REFRESH=golden python -m pytest -m "" tests/test_golden.py`` writes rows and numbers anew,
but neither V nor the hashes; ``REFRESH=1``, which is for words, leaves all of it as it is.
"""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import io
import json
import os
import shlex
from pathlib import Path

import pytest
from test_tuning import FEW, VARY
from test_verify import TWO_CASES

import build_fmus
from orchestrator import Benchmark, Controller
from orchestrator.benchmark.draws import Entropy
from orchestrator.loop.scenario import Recurrence

GOLDEN = Path(__file__).parent / "golden"
INPUTS = json.loads((GOLDEN / "inputs.json").read_text(encoding="utf-8"))
COSTS = {
    ("DiagonalPID", "quick"): 122.18535525998455,
    ("DiagonalPID", "paper-c07"): 161.9613190217972,
    ("DiagonalPID", "strict-c00"): 190.35622144371413,
    ("TunedPID", "quick"): 97.15806033789835,
    ("TunedPID", "paper-c07"): 154.22091229495413,
    ("ManipulatorLQG", "quick"): 68.2490612149161,
    ("ManipulatorLQG", "paper-c07"): 107.47859636978656,
    ("DitheredLQG", "quick"): 75.335310703297,
    ("DitheredLQG", "paper-c07"): 109.84446557215205,
    ("RobustLQG", "strict-c00"): 78.77788340775069,
    ("SteadyLQG", "strict-c00"): 76.04365582658573,
}
"""V by controller and run."""

RUNS = {"quick": ("quick", (), 24), "paper-c07": ("paper", "c07.*", 18), "strict-c00": ("strict", "c00.*", 36)}
"""Protocol, patterns and number of cases."""

IN_C = ("RobustLQG", "SteadyLQG")
"""Controllers that need a compiler."""


def pinned(name, text):
    """What the file ``name`` holds; ``text`` itself with ``REFRESH=golden``, which is written there."""
    file = GOLDEN / name
    if os.environ.get("REFRESH") == "golden":
        file.write_text(text, encoding="utf-8")
    return file.read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "run"),
    [pytest.param(*key, marks=pytest.mark.needs("compiler") if key[0] in IN_C else ()) for key in COSTS],
)
def test_cases_and_cost_are_what_they_were(name, run, fmu_folder, tmp_path, request):
    protocol, only, count = RUNS[run]
    if (name, run) == ("DiagonalPID", "quick"):
        evaluation = request.getfixturevalue("quick")
    else:
        controller = Controller(build_fmus.build(name, fmu_folder))
        evaluation = Benchmark(protocol).evaluate(controller, only=only, recordings=False)
    written = (evaluation.save(tmp_path) / "cases.csv").read_text(encoding="utf-8")
    assert written == pinned(f"{name}.{run}.csv", written)
    assert evaluation.cost == COSTS[name, run]
    rows = list(csv.DictReader(io.StringIO(written)))
    assert len(rows) == count
    assert {row["status"] for row in rows} <= {"done", "unstable"}, "the file itself holds verdicts"


# The numbers of a search, a tuning and a certificate


def case_of(command):
    """The options of a command that repeats a case, as far as they say which: without FMU and protocol, whose paths are
    those of one test run."""
    words = shlex.split(command)
    options = words[next((place for place, word in enumerate(words) if word.startswith("--")), len(words)) :]
    if "--protocol" in options:
        place = options.index("--protocol")
        del options[place : place + 2]
    return shlex.join(options)


def numbers_of_search(found):
    """The numbers of a Robustness."""
    return {
        "simulations": found.simulations,
        "failures": found.failures,
        "complete": found.complete,
        "cut short": found.cut_short,
        "V": found.cost,
        "V of the list": found.protocol_cost,
        "criteria": {
            name: {
                "mean": entry.value,
                "mean of the list": entry.protocol,
                "largest": entry.worst_case.value,
                "case": case_of(entry.worst_case.command),
            }
            for name, entry in found.criteria.items()
        },
        "requirements": {
            name: {
                "passed": entry.passed,
                "kind": entry.kind,
                "status": entry.status.value,
                "limit cycle": entry.limit_cycle,
                "ratio": entry.ratio,
                "frequency": entry.frequency,
                "seeds failed, tried": [entry.seeds_failed, entry.seeds_tried],
                "case": case_of(entry.command),
            }
            for name, entry in found.requirements.items()
        },
        "broken": found.broken,
        "margins": {
            name: {
                "value": entry.value,
                "limit": entry.limit,
                "seeds failed, tried": [entry.seeds_failed, entry.seeds_tried],
                "case": case_of(entry.command),
            }
            for name, entry in found.margins.items()
        },
        "radius of V, of stability, limit": found.radius
        and [found.radius.cost, found.radius.stability, found.radius.limit],
        "configurations: q_a, V of the list, V": {
            entry.index: [entry.q_a1, entry.q_a2, entry.protocol, entry.found] for entry in found.configurations
        },
        "effects: sign, change": {
            f"{entry.parameter} on {entry.criterion}": [entry.sign, entry.change] for entry in found.effects
        },
        "path": [{"stage": step.stage, "simulations": step.simulations, "worst": step.worst} for step in found.path],
    }


def numbers_of_tuning(found):
    """The numbers of a Tuning; the importance, which is another package's, not to the last bit."""
    best = found.best
    return {
        "parameters": found.parameters,
        "trials": [numbers_of_trial(trial) for trial in found.trials],
        "whole protocol": [
            {
                "trial": entry.trial,
                "after": entry.after,
                "V": entry.cost,
                "V of the worst cases": entry.worst_cost,
                "broken": entry.broken,
                "cases": [case_of(command) for command in entry.commands],
            }
            for entry in found.judged
        ],
        "best": best
        and {
            "trial": numbers_of_trial(best.trial),
            "V": best.cost,
            "V with other draws": numbers_of_statistic(best.held_out),
            "V with other seeds": numbers_of_statistic(best.seeds),
            "V of the strict list": best.strict,
            "broken there": best.strict_broken,
            "not judged there": best.strict_not_judged,
            "overfitted": best.overfitted,
        },
        "importance": {name: round(share, 6) for name, share in found.importance.items()},
    }


def numbers_of_trial(trial):
    return {
        "number": trial.number,
        "values": trial.values,
        "objective": trial.objective,
        "V": trial.cost,
        "cycle": trial.cycle,
        "holds, cut short, judged": [trial.holds, trial.cut_short, trial.judged],
        "message": trial.message,
    }


def numbers_of_statistic(statistic):
    return {
        "mean": statistic.mean,
        "deviation": statistic.deviation,
        "smallest": statistic.smallest,
        "largest": statistic.largest,
        "without": statistic.without,
    }


def numbers_of_certificate(found):
    """The numbers of a Verification: those of its controller and of its references."""
    return {
        "controller": numbers_of_draws(found),
        **{name: numbers_of_draws(entry) for name, entry in found.references.items()},
    }


def numbers_of_draws(found):
    return {
        "complete": found.complete,
        "V: mean, sd": [found.cost.mean, found.cost.sd],
        "draws": [{"seed": draw.seed, "V": draw.cost, "digest": draw.cases} for draw in found.draws],
        "criteria": {
            name: {
                "mean, sd": [entry.mean, entry.sd],
                "target": entry.target,
                "worst case": numbers_of_worst(entry.worst_case),
            }
            for name, entry in found.criteria.items()
        },
        "requirements": {
            name: {
                "passed": entry.passed,
                "kind": entry.kind,
                "failed draws": entry.failed_draws,
                "cases, failed, not judged": [entry.tally.cases, entry.tally.failed, entry.tally.not_judged],
                "worst case": numbers_of_worst(entry.worst_case),
            }
            for name, entry in found.requirements.items()
        },
        "cases": [[case.id, case.seed, case.status.value, case.time] for case in found.cases],
    }


def numbers_of_worst(worst):
    return worst and [worst.id, worst.seed, worst.value]


SMALL = """
extends = "strict"
name = "small"
grid = { q_a1_points = 1, q_a2_points = 1, also_deg = [[0.0, -90.0]] }
sets = { all = ["compliant", "slippery"] }
[disturbance]
t_1 = 1.0
t_2 = 1.1
t_4 = 0.9
[stability]
limit_cycle_window = 0.5
rest_window = 0.5
rest_error = 0.01
[[tests]]
name = "noise"
systems = "all"
duration = 0.2
disturbed = false
criteria = ["B1", "B2"]
[[tests]]
name = "disturbance"
systems = "all"
duration = 5.0
criteria = ["B3", "B4", "B5", "B6", "B7"]
requirements = ["A3"]
[[tests]]
name = "gain_1"
systems = "all"
duration = 4.0
axis = 1
gain = 2.5
requirements = ["A1", "A3"]
[[tests]]
name = "delay_2"
systems = "all"
duration = 4.0
axis = 2
delay = "1.5e-3"
requirements = ["A2", "A3"]
"""
"""A protocol in which the PID holds one requirement of three, and has margins of gain and delay and both radii."""


def protocol_file(folder, name, text):
    """The file of a protocol."""
    (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    return folder / f"{name}.toml"


def searched(controller, folder):
    """A search for everything, from the list."""
    return numbers_of_search(
        Benchmark().robustness(controller, protocol=protocol_file(folder, "small", SMALL), budget=240)
    )


def searched_without_list(controller, folder):
    """A search for one criterion, from the nominal system."""
    options = {"budget": 100, "only": ["B5"], "from_list": False}
    return numbers_of_search(
        Benchmark().robustness(controller, protocol=protocol_file(folder, "small", SMALL), **options)
    )


def tuned(controller, folder):
    """A tuning of three generations; a failure of its first candidate on the whole protocol is added."""
    whole, short = (
        protocol_file(folder, name, FEW.format(name=name, system=system))
        for name, system in (("whole", "nominal"), ("short", "compliant"))
    )
    return numbers_of_tuning(Benchmark(whole).tune(controller, VARY, trials=16, objective=short, strict=short))


def verified(controller, folder):
    """Two draws beside a reference."""
    options = {"draws": Entropy("1" * 64), "count": 2, "strict": False, "beside": ["TunedPID"]}
    protocol = protocol_file(folder, "two", TWO_CASES)
    return numbers_of_certificate(Benchmark().verify(controller, protocol=protocol, **options))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("robustness", searched),
        ("robustness-B5", searched_without_list),
        pytest.param("tuning", tuned, marks=pytest.mark.needs("optuna", "cmaes")),
        pytest.param("verification", verified, marks=pytest.mark.needs("linux")),
    ],
    ids=["robustness", "robustness-B5", "tuning", "verification"],
)
def test_what_studies_find_is_what_it_was(name, numbers, pid_file, tmp_path):
    """With the PID in Python, whose bytes are the same everywhere: the draws of a verification follow from them."""
    found = json.dumps(numbers(Controller(pid_file), tmp_path), indent=1, sort_keys=True) + "\n"
    assert found == pinned(f"DiagonalPID.{name}.json", found)


@pytest.mark.parametrize("name", INPUTS["fmus"])
def test_fmus_have_the_bytes_of_the_leaderboard(name: str, fmu_folder: Path) -> None:
    assert hashlib.sha256(build_fmus.build(name, fmu_folder).read_bytes()).hexdigest() == INPUTS["fmus"][name]


@pytest.mark.parametrize("name", ["paper", "quick"])
def test_cases_are_those_of_the_leaderboard(name: str) -> None:
    digest = hashlib.sha256()
    for case in Benchmark(name).cases:
        scenario = dataclasses.asdict(case.scenario)
        del scenario["stop_time"]  # what FMUs are told; no number depends on it
        assert scenario.pop("again") == dataclasses.asdict(Recurrence())  # of no case of these
        assert not scenario["drive"].pop("dropout") and not scenario["sensor"].pop("jitter")  # of no case of a protocol
        digest.update(json.dumps([case.id, scenario], default=str).encode())
    assert digest.hexdigest() == INPUTS[name]
