"""What the service does under load and under fire: the figures of docs/service.md.

    python benchmarks/service.py first         seconds from the upload to the first score, from an idle start
    python benchmarks/service.py uploads       100 FMUs of 20 people within a minute: how fast is everything answered
    python benchmarks/service.py kills         kill -9 of the service and its jobs at random moments
    python benchmarks/service.py growth        memory of the service over many submissions
    python benchmarks/service.py day           evaluations a day, from some that follow each other

Each starts a service of its own on loopback, in a temporary folder, which ends with it.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import zipfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import psutil

import build_fmus
from orchestrator import Benchmark, Controller
from orchestrator.service import accounts
from orchestrator.service.client import Client
from orchestrator.service.database import Database
from orchestrator.service.files import Files

ONE_POSE = (
    'extends = "quick"\nname = "{}"\n[grid]\nq_a1_points = 1\nq_a2_points = 1\n'
    '[selection]\nposes = [0]\ntests = ["noise", "disturbance"]\n'
)
"""A protocol of a few cases, for what is not about the cases."""


class Serving:
    """A service in a process of its own, in ``folder``."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.folder, self._options = folder, options
        self.begin()

    def begin(self) -> None:
        """Start it, again if it was killed."""
        words = [sys.executable, "-m", "orchestrator.serve", "--data", str(self.folder), "--port", "0", *self._options]
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.url = self.process.stdout.readline().split()[0]

    def jobs(self) -> list[psutil.Process]:
        """The processes of its jobs."""
        with contextlib.suppress(psutil.Error):
            return psutil.Process(self.process.pid).children(recursive=True)
        return []

    def memory(self) -> float:
        """What its process takes [MB]."""
        return psutil.Process(self.process.pid).memory_info().rss / 1e6

    def end(self, how: int = signal.SIGTERM) -> None:
        """End it."""
        self.process.send_signal(how)
        self.process.wait()


@contextlib.contextmanager
def serving(*options: str, short: bool = False) -> Iterator[Serving]:
    """A service in a temporary folder; with ``short`` protocols if only the way there counts."""
    with tempfile.TemporaryDirectory() as place:
        if short:
            (Path(place) / "short.toml").write_text(ONE_POSE.format("short"), encoding="utf-8")
            options = (*options, "--protocol", str(Path(place) / "short.toml"))
        service = Serving(Path(place) / "data", *options)
        try:
            yield service
        finally:
            service.end()


def first(fmu: Path, rounds: int) -> None:
    """Seconds from the upload to the first score: with nothing compiled yet, and again."""
    with serving() as service:
        for number in range(rounds):
            begin, client = time.monotonic(), Client(service.url)
            run, reached = client.submit(fmu), dict[str, float]()
            while run["quick_cost"] is None:
                assert not run["is_final"], run
                if run["findings"] or run["verdict"]:
                    reached.setdefault("first finding", time.monotonic() - begin)
                if run["verdict"]:
                    reached.setdefault("checked", time.monotonic() - begin)
                time.sleep(0.2)
                run = client.ask("GET", f"/api/runs/{run['id']}")
            reached["first score"] = time.monotonic() - begin
            client.ask("DELETE", f"/api/runs/{run['id']}")
            cold = "again" if number else "nothing compiled yet"
            print(f"{cold}: " + ", ".join(f"{name} after {seconds:.1f} s" for name, seconds in reached.items()))


def uploads(fmu: Path, count: int, people: int, minutes: float) -> None:
    """Many uploads of many people while evaluations run; all times from the client's side."""
    with tempfile.TemporaryDirectory() as place:
        files = Files(Path(place) / "data")
        files.prepare()
        database = Database(files.database)
        keys = [accounts.invited(database, f"Person {number}") for number in range(people)]
        database.close()
        service = Serving(files.root, "--accounts", "--evaluations", "2", "--max-queue", "1000")
        try:
            # Two evaluations are under way before the crowd comes.
            for key in keys[:2]:
                Client(service.url, key).submit(fmu)
            _until(lambda: sum(_states(service, keys[:2], "evaluating")) >= 2, 1200.0)
            answers: dict[str, list[float]] = {"upload": [], "table": [], "start page": [], "run": []}
            threads = [
                threading.Thread(target=_crowd, args=(service.url, key, fmu, count // people, 60 * minutes, answers))
                for key in keys
            ]
            before, begin = service.memory(), time.monotonic()
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            took = time.monotonic() - begin
            print(f"{len(answers['upload'])} uploads of {people} people in {took:.0f} s, two evaluations under way")
            for name, times in answers.items():
                ordered = sorted(1e3 * each for each in times)
                high = ordered[int(0.95 * len(ordered))]
                middle = statistics.median(ordered)
                print(f"{name}: median {middle:.0f} ms, 95 % {high:.0f} ms, largest {ordered[-1]:.0f} ms")
            print(f"memory of the service: {before:.0f} MB before, {service.memory():.0f} MB after")
        finally:
            service.end()


def _crowd(url: str, key: str, fmu: Path, count: int, seconds: float, answers: dict[str, list[float]]) -> None:
    client, chance = Client(url, key), random.Random(key)
    for _ in range(count):
        time.sleep(chance.uniform(0.5, 1.0) * seconds / count)
        run = _timed(answers["upload"], lambda: client.submit(fmu))
        _timed(answers["table"], lambda: client.ask("GET", "/api/table"))
        _timed(answers["start page"], lambda: client.ask("GET", "/"))
        _timed(answers["run"], lambda id=run["id"]: client.ask("GET", f"/api/runs/{id}"))


def _timed(times: list[float], call: Callable[[], dict]) -> dict:
    begin = time.monotonic()
    answer = call()
    times.append(time.monotonic() - begin)
    return answer


def _states(service: Serving, keys: Sequence[str], *states: str) -> list[int]:
    runs = [run for key in keys for run in Client(service.url, key).ask("GET", "/api/runs")["answer"]]
    return [run["state"] in states for run in runs]


def _until(met: Callable[[], bool], seconds: float) -> None:
    end = time.monotonic() + seconds
    while not met():
        assert time.monotonic() < end, "it takes too long"
        time.sleep(0.5)


def kills(fmu: Path, count: int, submissions: int, pause: float, seed: int) -> None:
    """Kill the service, a job or a worker at random moments; count what is lost, twice, or not equal. What has failed
    three times, visibly, is begun again as its owner would."""
    chance, killed = random.Random(seed), {"service": 0, "job": 0}
    with serving("--trust", "--evaluations", "1", "--max-queue", "1000", short=True) as service:
        ids = [Client(service.url).submit(fmu)["id"] for _ in range(submissions)]
        while sum(killed.values()) < count:
            # Some come during a check, which begins anew, others later: each stage has to end now and then.
            time.sleep(chance.uniform(0.05, pause))
            jobs = service.jobs()
            if chance.random() < 0.6 or not jobs:
                service.end(signal.SIGKILL)
                killed["service"] += 1
                service.begin()
            else:
                with contextlib.suppress(psutil.Error):
                    chance.choice(jobs).kill()
                    killed["job"] += 1
            client = Client(service.url)
            runs = [client.ask("GET", f"/api/runs/{id}") for id in ids]
            for run in runs:
                if run["state"] == "failed":  # three kills in one stage: visibly a fault of the machine
                    client.ask("POST", f"/api/runs/{run['id']}/retry")
            if all(run["state"] == "finished" for run in runs):
                ids.append(client.submit(fmu)["id"])
        for id in ids:
            if Client(service.url).follow(id, lambda run: None)["state"] == "failed":
                Client(service.url).ask("POST", f"/api/runs/{id}/retry")
        ends = [Client(service.url).follow(id, lambda run: None) for id in ids]
        protocol = str(service.folder.parent / "short.toml")
        Benchmark(protocol).evaluate(Controller(fmu), folder=service.folder.parent / "mine")
        wanted = _cases(service.folder.parent / "mine")
        equal = [_cases(service.folder / "runs" / id / "evaluation") == wanted for id in ids]
        once = [[event["text"] for event in run["history"]].count("finished") == 1 for run in ends]
    again = sum(event["text"] == "begun again" for run in ends for event in run["history"])
    told = f"{killed['service']} kills of the service, {killed['job']} of its jobs and workers"
    print(f"{told}, {len(ids)} submissions, {again} times begun again by hand after three faults:")
    print(
        f"finished {sum(run['state'] == 'finished' for run in ends)}, once {sum(once)}, equal to the bit {sum(equal)}"
    )


def _cases(folder: Path) -> str:
    return json.dumps(json.loads((folder / "results.json").read_text(encoding="utf-8"))["cases"])


def growth(count: int) -> None:
    """Memory of the service while FMUs that cannot be used come, are refused, and are deleted."""
    with serving("--trust", "--max-queue", "100000") as service:
        client, content = Client(service.url), b"PK" + bytes(1000)
        for number in range(count + 1):
            run = client.ask("POST", f"/api/runs?name={number}.fmu", content)
            client.ask("GET", "/")
            client.ask("GET", f"/runs/{run['id']}")
            client.ask("DELETE", f"/api/runs/{run['id']}")
            if number % max(count // 4, 1) == 0:
                print(f"{number} submissions: {service.memory():.1f} MB")


def day(fmu: Path, count: int, scheduler: str) -> None:
    """Evaluations a day, by the time from the first that is finished to the last: each FMU has other bytes, so that
    nothing of it is in the store. With the address of a Dask ``scheduler``, on its workers."""
    with serving(*(("--scheduler", scheduler) if scheduler else ())) as service:
        client, ends = Client(service.url), []
        for number in range(count):
            other = service.folder.parent / f"controller-{number}.fmu"
            shutil.copy(fmu, other)
            with zipfile.ZipFile(other, "a") as archive:
                archive.comment = str(number).encode()
            client.submit(other)
        while len(ends) < count:
            runs = client.ask("GET", "/api/runs")["answer"]
            assert all(run["state"] == "finished" or not run["is_final"] for run in runs), runs
            ends += [time.monotonic()] * (sum(run["is_final"] for run in runs) - len(ends))
            time.sleep(0.1)
        each = (ends[-1] - ends[0]) / (count - 1)
        print(f"an evaluation in {each:.1f} s, with check and quick evaluation: {86400 / each:.0f} a day")


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("first", "uploads", "kills", "growth", "day"))
    parser.add_argument("--count", type=int, help="uploads, kills, submissions or evaluations")
    parser.add_argument("--rounds", type=int, default=2, help="of first")
    parser.add_argument("--submissions", type=int, default=30, help="of kills, at the least")
    parser.add_argument("--pause", type=float, default=15.0, help="longest time [s] between two kills")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scheduler", default="", help="of day: the address of a Dask scheduler")
    given = parser.parse_args()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the start")
    with tempfile.TemporaryDirectory() as place:
        fmu = build_fmus.build("DiagonalPID_C", Path(place))
        if given.what == "first":
            first(fmu, given.rounds)
        elif given.what == "uploads":
            uploads(fmu, given.count or 100, 20, 1.0)
        elif given.what == "kills":
            kills(fmu, given.count or 200, given.submissions, given.pause, given.seed)
        elif given.what == "growth":
            growth(given.count or 2000)
        else:
            day(fmu, given.count or 10, given.scheduler)


if __name__ == "__main__":
    main()
