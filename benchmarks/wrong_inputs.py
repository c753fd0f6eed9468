"""Wrong command lines, protocol files, parameter files, and matrices or weights: how many end in a traceback.

    python benchmarks/wrong_inputs.py                    1,000 inputs, 250 of each kind
    python benchmarks/wrong_inputs.py --seed 7 --each 1000

Every input is a right one with words, values or bytes changed, and is given to the command in this process. Nothing is
simulated or compiled: what would be ends with an error of the machine. The exit code is 1 if anything but an error of
the family or of the parser came out; each of these is printed with the input that causes it.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import random
import shutil
import signal
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests")]

import numpy as np  # noqa: E402
from scipy.io import savemat  # noqa: E402
from support.reports import RECORDINGS, results_of, searched  # noqa: E402

from benchmarks.fuzz import damaged  # noqa: E402
from orchestrator.benchmark import protocol as protocols  # noqa: E402
from orchestrator.cli.guard import run  # noqa: E402
from orchestrator.documents.evaluation import Evaluation  # noqa: E402
from orchestrator.errors import EnvironmentFault  # noqa: E402
from orchestrator.pairing.built_in import built_in  # noqa: E402
from orchestrator.study.engine import Engine  # noqa: E402

LINES = """
evaluate pid.fmu --quick --set K_p[1]=45 --only c00.* --jobs 1 --no-report
evaluate --protocol strict --seeds 0-3 --parameters right.toml --timeout 60 --dry-run
simulate pid.fmu --case c07.compliant.gain_1 --map q_m[1]=q_m[1] --dry-run
simulate --configuration 45 -60 --system random_3 --test noise --gain 2 1 --phi-F 1.5 --seed 3 --dry-run
simulate pid.fmu --undisturbed --force 500 --force-direction 90 --t-1 1 --t-2 1.5 --duration 6 --with other.fmu
simulate --from run --case c07.compliant.gain_1 --csv --mat
robustness pid.fmu --budget 2000 --only B6 --only A1 --minutes 1 --restarts 2
reliability pid.fmu --draws 20 --probability 0.1 --confidence 0.9 --distribution corners
verify pid.fmu --protocol quick --memory-limit 512
tune pid.fmu --vary K_p[1]=20:80:log --vary z_p[1]=0.8:0.99 --trials 10 --robust 900 --sampler tpe
sweep pid.fmu --vary K_p[1]=20:80:5 --plant-set k_high[2]=5e5
linearize --configuration 45 -60 --system compliant --test delay_2 --friction sliding --output model.mat
linearize right.mat --robustness worst --configuration 18 -50 --json
check pid.fmu --sample-time 0.00025 --json
compare run worst --latex
report run --markdown
runs . --csv
new statespace right.mat --sample-time 0.00025 --method zoh --dry-run
new mlp right.npz --out policy.fmu --dry-run
new python kit --dry-run
build kit --dry-run
completion
"""
"""Right command lines, all of whose files exist."""

WORDS = (
    *("", "-1", "nan", "1e400", "0", "inf", "1/0", "--", "-", "=", "a=b=c", "1:2:3:4", "0-", "c99.x.y", "[1", "'"),
    *("../..", "/", ".", "run", "right.toml", "--json", "--help-me", "%s", "{value}", "ä" * 300, "\udcff"),
)
"""What stands in the place of right ones."""

TOML = ("nan", "-1", '"x"', "[]", "{}", "1e400", "true", "99999999999999999999", "''", "[[1]]", "1979-05-27")


class NotRun(EnvironmentFault):
    """Stands for whatever would be simulated."""


LONGEST = 30
"""Seconds that an input may take; the signal after that ends the command with a traceback."""


def late(*_: Any) -> None:
    """What the signal does."""
    raise TimeoutError(f"no answer within {LONGEST} s")


def stopped(*_: Any, **__: Any) -> Any:
    """Simulates nothing."""
    raise NotRun("nothing is simulated here", "not-run")


def line(chance: random.Random, place: Path) -> list[str]:
    """A command line with one to three words changed."""
    words = chance.choice(LINES.strip().splitlines()).split()
    for _ in range(chance.randint(1, 3)):
        at, how = chance.randrange(1, len(words) + 1), chance.randrange(4)
        if how == 0 and at < len(words):
            del words[at]
        elif how == 1:
            words.insert(at, chance.choice(WORDS))
        elif how == 2 and at < len(words):
            words[at] = chance.choice(WORDS)
        else:
            words.insert(at, chance.choice(chance.choice(LINES.strip().splitlines()).split()[1:] or ["x"]))
    return words


def protocol_file(chance: random.Random, place: Path) -> list[str]:
    """A protocol with values, names or bytes changed."""
    text = (Path(protocols.__file__).parent / "protocols" / f"{chance.choice(protocols.names())}.toml").read_text()
    (place / "wrong.toml").write_bytes(changed_toml(text, chance))
    command = chance.choice([["simulate", "--dry-run"], ["evaluate", "--quick", "--list"], ["evaluate", "--list"]])
    return [*(word for word in command if word != "--quick"), "--protocol", "wrong.toml"]


def parameter_file(chance: random.Random, place: Path) -> list[str]:
    """A parameter or mapping file with values, names or bytes changed."""
    option, text = chance.choice(
        [
            ("--parameters", (place / "right.toml").read_text()),
            ("--mapping", '[map]\n"q_m[1]" = "q_m[1]"\n"u_m[2]" = "u_m[2]"\n'),
        ]
    )
    if chance.random() < 0.3:
        ending = ".ssv" if option == "--parameters" else ".ssm"
        content = damaged(SSV.encode(), chance)
    else:
        ending, content = ".toml", changed_toml(text, chance)
    (place / f"wrong{ending}").write_bytes(content)
    return ["simulate", "pid.fmu", "--dry-run", option, f"wrong{ending}"]


SSV = """<?xml version="1.0"?>
<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" name="x">
<ssv:Parameters><ssv:Parameter name="K_p[1]"><ssv:Real value="45"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet>
"""


def changed_toml(text: str, chance: random.Random) -> bytes:
    """A file of TOML with a value or a name changed, a line doubled or left out, or bytes damaged."""
    lines = text.splitlines()
    for _ in range(chance.randint(1, 3)):
        at, how = chance.randrange(len(lines)), chance.randrange(5)
        name, equals, _ = lines[at].partition("=")
        if how == 0 and equals:
            lines[at] = f"{name}= {chance.choice(TOML)}"
        elif how == 1:
            lines[at] = chance.choice(["x = 1", "[x]", "[[tests]]", lines[at][::-1], lines[at].upper()])
        elif how == 2:
            lines.insert(at, lines[at])
        elif how == 3 and len(lines) > 1:
            del lines[at]
        else:
            return damaged("\n".join(lines).encode(), chance)
    return "\n".join(lines).encode()


def matrices(chance: random.Random, place: Path) -> list[str]:
    """Matrices of a controller or weights of a network with arrays or bytes changed."""
    ending = chance.choice([".mat", ".npz", ".json", "policy"])
    arrays: dict[str, Any] = WEIGHTS if ending == "policy" else MATRICES
    arrays = dict(arrays)
    for _ in range(chance.randint(0, 2)):
        name = chance.choice(sorted(arrays))
        value = np.atleast_1d(np.asarray(arrays[name]))
        same = value.ravel(), value[..., None], value[:0], value[::-1], value.astype(object)
        others = "x", np.nan, np.inf, 1j, -1.0, 3, [[]], np.array(["a", "b"]), {"a": 1}, None
        arrays[name] = chance.choice([*same, *others])
    kept = {name: value for name, value in arrays.items() if value is not None}
    file = place / f"wrong{'.npz' if ending == 'policy' else ending}"
    stream = io.BytesIO()
    if ending == ".mat":
        savemat(stream, kept)
    elif ending == ".json":
        plain = {
            name: np.asarray(value).tolist() if not isinstance(value, dict) else value for name, value in kept.items()
        }
        stream.write(repr(plain).replace("'", '"').replace("nan", "NaN").encode())
    else:
        np.savez(stream, **kept)
    content = stream.getvalue()
    file.write_bytes(damaged(content, chance) if chance.random() < 0.5 else content)
    if ending == "policy":
        return ["new", "mlp", file.name, "--out", "wrong.fmu"]
    return chance.choice([["linearize", file.name], ["new", "statespace", file.name, "--out", "wrong.fmu"]])


MATRICES = {"A": 0.5 * np.eye(2), "B": np.eye(2), "C": np.eye(2), "D": np.zeros((2, 2)), "T_s": 0.25e-3}
WEIGHTS = {"W1": np.ones((3, 8)), "b1": np.zeros(3), "W2": np.ones((2, 3)), "b2": np.zeros(2), "activation": "tanh"}

KINDS: dict[str, Callable[[random.Random, Path], list[str]]] = {
    "command lines": line,
    "protocol files": protocol_file,
    "parameter files": parameter_file,
    "matrices": matrices,
}


@contextlib.contextmanager
def prepared() -> Iterator[Path]:
    """A folder with the right files, in which nothing is simulated and nothing compiled."""
    before = os.getcwd()
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        place = Path(name)
        for file in ("pid.fmu", "other.fmu"):
            shutil.copy(built_in("DiagonalPID"), place / file)
        (place / "right.toml").write_text('[parameters]\n"K_p[1]" = 45.0\n"K_p[2]" = 12.0\n"z_p[1]" = 0.9\n')
        savemat(place / "right.mat", MATRICES)
        np.savez(place / "right.npz", **WEIGHTS)
        Evaluation(results_of(), RECORDINGS).save(place / "run")
        searched().save(place / "worst")
        for target in ("run", "plan"):
            stack.enter_context(mock.patch.object(Engine, target, stopped))
        for room in ("pairing.pairing", "api.checking", "api.linear"):
            stack.enter_context(mock.patch(f"orchestrator.{room}.run_isolated", stopped))
        stack.enter_context(mock.patch("orchestrator.cli.verify.run_clean", stopped))
        stack.enter_context(mock.patch("controller_fmu.export.state_space.c_fmu", stopped))
        stack.enter_context(mock.patch("controller_fmu.export.mlp.c_fmu", stopped))
        os.chdir(place)
        try:
            yield place
        finally:
            os.chdir(before)


def outcome(words: Sequence[str]) -> tuple[str, str]:
    """What became of a command line: its exit code, or ``traceback`` and that."""
    signal.alarm(LONGEST)
    silent = io.TextIOWrapper(io.BytesIO(), "utf-8", "replace")
    with contextlib.redirect_stdout(silent), contextlib.redirect_stderr(silent):
        try:
            return f"exit code {run(words[0], words[1:])}", ""
        except SystemExit as end:
            return f"exit code {end.code or 0}", ""
        except Exception:
            return "traceback", traceback.format_exc()
        finally:
            signal.alarm(0)


def count(seed: int, each: int) -> tuple[dict[str, Counter[str]], list[str]]:
    """Outcomes by kind of input, and a text for each traceback."""
    signal.signal(signal.SIGALRM, late)
    chance = random.Random(seed)
    outcomes: dict[str, Counter[str]] = {kind: Counter() for kind in KINDS}
    problems = []
    with prepared() as place:
        for kind, make in KINDS.items():
            for number in range(each):
                words = make(chance, place)
                found, told = outcome(words)
                outcomes[kind][found] += 1
                if told:
                    problems.append(f"{kind} {number}: {words}\n{told}")
    return outcomes, problems


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0, help="default: 0")
    parser.add_argument("--each", type=int, default=250, help="inputs of each kind (default: 250)")
    outcomes, problems = count(**vars(parser.parse_args()))
    print(*problems, sep="\n")
    for kind, counted in outcomes.items():
        print(f"{kind:16}", ", ".join(f"{number} {how}" for how, number in sorted(counted.items())))
    print(f"{sum(map(Counter.total, outcomes.values()))} inputs, {len(problems)} tracebacks")
    return 1 if problems else 0


if __name__ == "__main__":
    raise SystemExit(main())
