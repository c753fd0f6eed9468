"""Mutated messages of workers, answers of isolated controllers, results.json, trajectories.npz and verification.json:
each is refused in one clear error, or makes sense.

    python benchmarks/fuzz.py                    10,000 messages, 10,000 answers, 300 results.json, 100 trajectories.npz
                                                 3,000 verification.json
    python benchmarks/fuzz.py --seed 7 --messages 100000

Counts what came of them. The exit code is 1 if anything but an error of the family was raised, or something was
accepted that makes no sense: a number that is not finite, text that cannot be encoded, a judgement that its case cannot
have come to, a scorecard that is not that of the cases.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import functools
import io
import json
import math
import os
import random
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests")]

import msgspec  # noqa: E402
import numpy as np  # noqa: E402
from msgspec.structs import replace  # noqa: E402
from support.reports import RECORDINGS, results_of, verified  # noqa: E402

from benchmarks import leaderboard_tables as tables  # noqa: E402
from orchestrator import Benchmark, Controller, compare  # noqa: E402
from orchestrator.benchmark import protocol as protocols  # noqa: E402
from orchestrator.benchmark.cases import cases  # noqa: E402
from orchestrator.benchmark.certificate import overall  # noqa: E402
from orchestrator.benchmark.metrics import case_result, expected  # noqa: E402
from orchestrator.benchmark.results import CaseResult, Judgement, Measurements, rules  # noqa: E402
from orchestrator.benchmark.scorecard import score  # noqa: E402
from orchestrator.codec import Malformed, pack, plain, to_json, unpack  # noqa: E402
from orchestrator.documents import verification as certificates  # noqa: E402
from orchestrator.documents.evaluation import Evaluation  # noqa: E402
from orchestrator.documents.files import RESULTS, TRAJECTORIES, VERIFICATION  # noqa: E402
from orchestrator.documents.head import SampleTimeRecord  # noqa: E402
from orchestrator.documents.recording import OBSERVED, Recording, about_case  # noqa: E402
from orchestrator.documents.verification import CHECKED, Verification, differences  # noqa: E402
from orchestrator.errors import BenchmarkError, FmuError, InputError  # noqa: E402
from orchestrator.execution.isolation import Isolated, Over, Ready  # noqa: E402
from orchestrator.execution.messages import (  # noqa: E402
    Failed,
    Finished,
    FmuFiles,
    Garbage,
    Inbox,
    Loaded,
    error_record,
)
from orchestrator.fmi.archive import open_archive  # noqa: E402
from orchestrator.fmi.port import LOST, WARNING, exchange  # noqa: E402
from orchestrator.loop.trajectory import Ending, Status, Trajectory  # noqa: E402
from orchestrator.pairing import work  # noqa: E402
from orchestrator.pairing.built_in import built_in  # noqa: E402
from orchestrator.study.verify import repeat  # noqa: E402
from plant_fmu.flexible_manipulator.parameters import NOMINAL  # noqa: E402

PROTOCOL = protocols.load("quick")
CASE = cases(PROTOCOL, NOMINAL, 0)[0]
SAMPLES = 5
ROLES = ("B5",)

NONSENSE: tuple[Any, ...] = (
    None, True, 0, -1, 2**63 - 1, -(2**63), 2**64 - 1, 10**400, 0.5, -1e-300, 1e308, -1e308, math.nan, math.inf,
    -math.inf,
    "", "1", "done", "\ud800", "\x1b[2J", "\u202e", "1e300000000", "1/0", "x" * 5000, [], [[]], {}, {"x": 1},
)  # fmt: skip
"""What takes the place of values; JSON and MessagePack get those they can express."""

Refusal = (BenchmarkError, Malformed, Garbage)


def mutated(document: Any, chance: random.Random) -> Any:
    """``document`` with one to three of its values replaced, left out, added or exchanged."""
    document = copy.deepcopy(document)
    for _ in range(chance.randint(1, 3)):
        places = [(parent, key) for parent in _containers(document) for key in _keys(parent)]
        if not places:
            return document
        parent, key = chance.choice(places)
        how = chance.randrange(5)
        if how == 0:
            del parent[key]
        elif how == 1 and isinstance(parent, dict):
            parent[f"{key}_"] = parent[key]
        elif how == 1:
            parent.insert(key, copy.deepcopy(parent[key]))
        elif how == 2 and isinstance(parent[key], (int, float)):
            parent[key] = chance.choice([-parent[key], parent[key] * 2, parent[key] + 1, str(parent[key])])
        elif how == 3:
            other_parent, other = chance.choice(places)
            parent[key] = copy.deepcopy(other_parent[other])
        else:
            parent[key] = copy.deepcopy(chance.choice(NONSENSE))
    return document


def _containers(document: Any) -> Iterator[Any]:
    if isinstance(document, (dict, list)):
        yield document
        for value in document.values() if isinstance(document, dict) else document:
            yield from _containers(value)


def _keys(parent: Any) -> list[Any]:
    return list(parent) if isinstance(parent, dict) else list(range(len(parent)))


def damaged(data: bytes, chance: random.Random) -> bytes:
    """``data`` with bytes changed, cut out, doubled, or cut short."""
    changed = bytearray(data)
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(changed)) if changed else 0
        how = chance.randrange(4)
        if how == 0 and changed:
            changed[at] ^= 1 << chance.randrange(8)
        elif how == 1:
            del changed[at : at + chance.randint(1, 8)]
        elif how == 2:
            changed[at:at] = changed[at : at + chance.randint(1, 8)]
        else:
            del changed[at:]
    return bytes(changed)


def check_sense(value: Any) -> None:
    """Raise :class:`ValueError` for numbers that are not finite and for text that cannot be encoded."""
    json.dumps(value, allow_nan=False, ensure_ascii=False).encode()


def check_judgement(found: Judgement) -> None:
    check_sense(plain(found))
    assert found.measurements.names in (expected(PROTOCOL, CASE), frozenset())
    assert 0.0 <= found.time <= float(CASE.scenario.duration)


def check_trajectory(found: Trajectory) -> None:
    check_sense(found.ending.time)
    states = len(found.time)
    assert found.q_m.shape == found.X.shape == (states, 2) and found.torque.shape == (states - 1, 2)
    assert np.isfinite(found.time).all()


def check_recording(found: Recording) -> None:
    check_sense(plain(found.about))
    assert np.isfinite(found.motion).all() and np.isfinite(found.torque).all()


def check_sent_recording(found: Recording) -> None:
    check_recording(found)
    told = found.about
    assert about_case(CASE, ROLES, told.u_m0, Ending(told.status, told.time, told.message)) == told


def _trajectory() -> Trajectory:
    rows, pairs = np.arange(SAMPLES + 1) * 0.25e-3, np.zeros((SAMPLES + 1, 2))
    extra = dict.fromkeys(OBSERVED, rows)
    ending = Ending(Status.DONE, 1.25e-3)
    return Trajectory(rows, pairs, pairs, extra, pairs, *(pairs[:-1],) * 3, (0.0, 0.0), (1.0, 2.0), ending)


def _judgement() -> Judgement:
    measured = Measurements(**dict.fromkeys(expected(PROTOCOL, CASE), 0.1))
    return Judgement(status=Status.DONE, time=1.0, message="why", measurements=measured, warnings=3)


def _recording() -> Recording:
    about = about_case(CASE, ROLES, (1.0, 2.0), Ending(Status.DONE, 1.25e-3))
    return Recording(about, RECORDINGS[0].motion, RECORDINGS[0].torque)


VALUES: dict[str, tuple[Any, Callable[[bytes], Any], Callable[[Any], None]]] = {
    "judgement": (_judgement(), lambda value: work.judged(PROTOCOL, CASE, value), check_judgement),
    "beginning": (
        work.Beginning((0.1, 0.2), (1.0, 2.0), (0.1, 0.2), b"digest"),
        lambda value: unpack(value, work.Beginning),
        lambda found: check_sense([found.q_m, found.u_m, found.q_a]),
    ),
    "times": (np.ones(SAMPLES), lambda value: work.times(SAMPLES, value), lambda found: check_sense(found.tolist())),
    "trajectory": (_trajectory(), lambda value: work.trajectory(SAMPLES, OBSERVED, value), check_trajectory),
    "recording": (_recording(), lambda value: work.recording(CASE, ROLES, value), check_sent_recording),
}
"""What workers send: a sample, how it is decoded, and what must be true of it."""

REPLIES = (Ready(), Over(("a line",)), Over(error=error_record(FmuError("it failed", "fmi2DoStep", ("why",)))))
"""What an isolated controller sends beside the answers of its steps."""

ENVELOPES = (Loaded(), Failed(0, error_record(FmuError("it failed", "fmi2DoStep", ("why",))), 0.1))


def message(chance: random.Random) -> tuple[bytes, str]:
    """A mutated frame, and what its value is if it has one."""
    kind = chance.choice([*VALUES, "", ""])
    if kind:
        value = pack(VALUES[kind][0])
        body = pack(Finished(0, _remade(value, chance) if chance.random() < 0.7 else value, 0.5))
    else:
        body = pack(chance.choice(ENVELOPES))
    if chance.random() < 0.5:
        body = _remade(body, chance)
    framed = len(body).to_bytes(4, "big") + body
    return (damaged(framed, chance) if chance.random() < 0.2 else framed), kind


def _remade(packed: bytes, chance: random.Random) -> bytes:
    """A packed document with other values, or other bytes."""
    if chance.random() < 0.3:
        return damaged(packed, chance)
    try:
        return msgspec.msgpack.encode(mutated(msgspec.msgpack.decode(packed), chance))
    except (OverflowError, UnicodeEncodeError):  # a number or a text that MessagePack cannot express
        return damaged(packed, chance)


class Fed(Inbox):
    """An inbox that is given bytes instead of a descriptor."""

    def __init__(self, data: bytes, largest: int) -> None:
        super().__init__(-1, largest)
        self._bytes += data


def read_message(data: bytes, kind: str) -> str:
    """Take a message in as the owner of a worker does; says what became of it."""
    found = list(Fed(data, 1 << 22).messages())
    for entry in found:
        check_sense(plain(entry.error) if isinstance(entry, Failed) else getattr(entry, "wall_time", 0.0))
        if isinstance(entry, Finished) and kind:
            _, decode, check = VALUES[kind]
            check(decode(entry.value))
    return "accepted" if found else "waits for more"


def answer(chance: random.Random) -> tuple[bytes, type[Ready | Over] | None]:
    """What an isolated controller might send, mutated, and the type of message that is due; None for the answer of a
    step, which is four numbers."""
    if chance.random() < 0.5:
        data = np.array(chance.choices([0.0, 1.0, 2.0, 5.0, -1.0, 1e300, math.nan, math.inf], k=4)).tobytes()
        return (damaged(data, chance) if chance.random() < 0.5 else data), None
    body = _remade(pack(chance.choice(REPLIES)), chance)
    framed = len(body).to_bytes(4, "big") + body
    return (damaged(framed, chance) if chance.random() < 0.3 else framed), chance.choice([Ready, Over])


@functools.cache
def isolated() -> Isolated:
    """The other side of the channel, without a process."""
    archive = open_archive(built_in("DiagonalPID"))
    own = Isolated(FmuFiles(archive.name, archive.sha256, str(archive.folder)), (sys.executable,))
    own._process = SimpleNamespace(pid=0, returncode=0, wait=lambda _seconds: 0)
    return own


def read_answer(data: bytes, due: type[Ready | Over] | None) -> str:
    """Take an answer in as the process of plant and judge does; says what became of it."""
    near, far = os.pipe()
    with open(near, "rb", 0) as source, open(os.devnull, "wb", 0) as nowhere:
        os.write(far, data)
        os.close(far)
        own = isolated()
        own._requests, own._answers = nowhere.fileno(), source.fileno()
        if due is not None:
            check_sense(own._ask(lambda: None, due).lines)
            return "accepted"
        port = own._port()
        _, status = exchange(port, port.inputs.size, 0.0, 0.25e-3, True)
    assert 0 <= status <= LOST
    return "accepted" if status <= WARNING else "refused"


def read_run(folder: Path) -> str:
    """Load a run, report and compare it; what is accepted must be consistent."""
    found = Evaluation.load(folder)
    check_sense(plain(found.results))
    assert score(found.results.rules, found.results.cases) == found.results.scorecard
    for recording in found.recordings:
        check_recording(recording)
    found.report(folder / "report.html")
    json.dumps(plain(found.results), allow_nan=False)
    compare([found])
    return "accepted"


def mutated_results(folder: Path, chance: random.Random) -> None:
    """Spoil results.json."""
    file = folder / RESULTS
    text = file.read_bytes()
    if chance.random() < 0.2:
        file.write_bytes(damaged(text, chance))
    else:
        file.write_text(json.dumps(mutated(json.loads(text), chance)))


def mutated_recordings(folder: Path, chance: random.Random) -> None:
    """Spoil trajectories.npz."""
    file = folder / TRAJECTORIES
    if chance.random() < 0.4:
        file.write_bytes(damaged(file.read_bytes(), chance))
        return
    with np.load(file) as stored:
        arrays = {name: stored[name] for name in stored.files}
    name = chance.choice(sorted(arrays))
    array = arrays[name].copy()
    if name == "about":
        arrays[name] = np.array(json.dumps(mutated(json.loads(str(array)), chance)))
    else:
        array.flat[chance.randrange(array.size)] = chance.choice([math.nan, math.inf, -1e30])
        forms = [array, array[..., :-1], array[:0], array.astype("U8"), array.ravel(), np.array(1.0)]
        arrays[name] = chance.choice(forms)
    if chance.random() < 0.3:
        del arrays[chance.choice(sorted(arrays))]
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=True, **arrays)
    file.write_bytes(stream.getvalue())


HOSTILE = (
    b"", b"{}", b"[]", b"null", b"[" * 100_000, b'{"a":' * 100_000, b"\xff\xfe{}", b"\0", b"NaN", b'{"schema": 1e999}',
    b"\xef\xbb\xbf{}", b'"' + b"x" * 10_000_000 + b'"',
)  # fmt: skip
"""Files that are no certificate."""


def certificate() -> Verification:
    """A certificate under the standard conditions, of a controller that settles in an instant and another of each
    reference's name."""
    drawn, listed = protocols.load(certificates.PROTOCOL), protocols.load(certificates.STRICT)

    def ended(protocol: protocols.Protocol, B5: float) -> list[CaseResult]:
        found = []
        for case in cases(protocol, NOMINAL, 0):
            figures = {name: True if name == "settled" else B5 for name in expected(protocol, case)}
            own = Judgement(status=Status.DONE, time=float(case.end), measurements=Measurements(**figures))
            found.append(case_result(case, own))
        return found

    pid = Controller().archive
    draws = [ended(drawn, 1e-6 * (1 + number)) for number in range(certificates.COUNT)]
    made = verified(draws, draws[0], draws[0], rules(drawn), file=pid.name, sha256=pid.sha256)
    strict = overall(rules(listed), [(made.draws[0].seed, ended(listed, 1e-6))])
    (reference,) = made.references.values()
    plant = replace(made.plant, nominal=NOMINAL)
    return replace(
        made,
        strict=strict,
        head=replace(made.head, sample_time=SampleTimeRecord(0.25e-3, True), plant=plant),
        references=dict.fromkeys(certificates.USUAL, replace(reference, strict=strict)),
        checked=made.checked * CHECKED,
    )


def mutated_certificate(folder: Path, chance: random.Random) -> None:
    """Spoil verification.json, seldom in one of its 636 cases."""
    file = folder / VERIFICATION
    text, how = file.read_bytes(), chance.random()
    if how < 0.1:
        file.write_bytes(chance.choice(HOSTILE))
    elif how < 0.3:
        file.write_bytes(damaged(text, chance))
    else:
        whole = json.loads(text)
        listed = {} if how < 0.4 else {"cases": whole.pop("cases")}
        changed = mutated(whole, chance)
        file.write_text(json.dumps({**changed, **listed} if isinstance(changed, dict) else changed))


def read_certificate(place: Path) -> str:
    """Load a certificate, show it, compare it, begin to repeat it, and list it beside a repetition."""
    found = Verification.load(place / VERIFICATION)
    check_sense(plain(found))
    found.report(place.parents[1] / "report.html")
    repr(found)
    compare([found])
    differences(found, found)
    with contextlib.suppress(InputError):
        next(repeat(Benchmark("verification", sandbox=True), found, None))
    with contextlib.suppress(InputError):
        listed = tables.verified_table(tables.submissions(place.parent, place.parents[1] / "repetitions"))
        own = f"[{place.name}](../{place.parent.name}/{place.name}/{VERIFICATION})"
        assert listed.count("\n") == 3 and listed.count(own) == 1 and not set(listed.replace(own, "")) & set("<>[]")
        return "listed"
    return "accepted"


def attempt(read: Callable[[], str], what: str, problems: list[str]) -> str:
    """What became of one mutation."""
    try:
        return read()
    except Refusal:
        return "refused"
    except Exception as problem:
        problems.append(f"{what}: {type(problem).__name__}: {problem}"[:300])
        return f"{type(problem).__name__}!"


def fuzz(
    seed: int, messages: int, answers: int, results: int, recordings: int, certificates: int
) -> tuple[dict[str, Counter[str]], list[str]]:
    """Outcomes by kind of input, and a line for each that is neither refused nor makes sense."""
    outcomes: defaultdict[str, Counter[str]] = defaultdict(Counter)
    problems: list[str] = []
    chance = random.Random(seed)
    for number in range(messages):
        data, kind = message(chance)
        outcomes["messages"][attempt(partial(read_message, data, kind), f"message {number} ({kind})", problems)] += 1
    for number in range(answers):
        data, due = answer(chance)
        outcomes["answers"][attempt(partial(read_answer, data, due), f"answer {number}", problems)] += 1
    with tempfile.TemporaryDirectory() as place:
        pristine = Path(place, "pristine")
        Evaluation(results_of(), RECORDINGS).save(pristine)
        files = {name: (pristine / name).read_bytes() for name in (RESULTS, TRAJECTORIES)}
        folder = Path(place, "run")
        folder.mkdir()
        spoilers = ((RESULTS, results, mutated_results), (TRAJECTORIES, recordings, mutated_recordings))
        for what, count, spoil in spoilers:
            for number in range(count):
                for name, content in files.items():
                    (folder / name).write_bytes(content)
                spoil(folder, chance)
                outcomes[what][attempt(partial(read_run, folder), f"{what} {number}", problems)] += 1
        place = Path(place, "submissions", "mine")
        place.mkdir(parents=True)
        (place / "README.md").write_text("how to make it")
        made = certificate()
        known, again = to_json(made).encode(), place.parents[1] / "repetitions"
        again.mkdir()
        later = replace(made, head=replace(made.head, timing=replace(made.timing, start="later")))
        (again / "mine.json").write_text(to_json(later))
        for number in range(certificates):
            (place / VERIFICATION).write_bytes(known)
            mutated_certificate(place, chance)
            how = attempt(partial(read_certificate, place), f"certificate {number}", problems)
            outcomes["certificates"][how] += 1
    return outcomes, problems


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    counts = {"seed": 0, "messages": 10000, "answers": 10000, "results": 300, "recordings": 100, "certificates": 3000}
    for name, default in counts.items():
        parser.add_argument(f"--{name}", type=int, default=default, help=f"default: {default}")
    outcomes, problems = fuzz(**vars(parser.parse_args()))
    for what, counted in outcomes.items():
        print(f"{what:18}", ", ".join(f"{count} {how}" for how, count in sorted(counted.items())))
    print(*problems, sep="\n")
    return 1 if problems else 0


if __name__ == "__main__":
    raise SystemExit(main())
