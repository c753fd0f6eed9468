"""What is loaded before workers are forked: all that a simulation needs, else each worker would load it anew."""

import json
import subprocess
import sys

import pytest

SIMULATION = """
import gc, json, sys
from numba.core.dispatcher import Dispatcher
from orchestrator import Benchmark, Controller
from orchestrator.fmi import slaves, trace
from orchestrator.pairing import work
from orchestrator.pairing.pairing import judge_job

def loaded():
    "The machine code and the modules there are."
    own = (each for each in gc.get_objects() if isinstance(each, Dispatcher))
    code = sorted(f"{each.py_func.__module__}.{each.py_func.__name__}{each.signatures}" for each in own)
    return code, sorted(name for name in sys.modules if name.startswith(("orchestrator", "fmpy", "numba")))

bench = Benchmark("quick")
_, pairing, _, cases = bench.prepared(Controller(sys.argv[1]))
job = judge_job(bench.rules, cases[:1], pairing)
work.prepare()
plant, controller = slaves.load(job.plant, trace.PLANT), slaves.load(job.controller, trace.CONTROLLER)
before = loaded()
work.judge_case(plant, controller, job.tasks[0])
print(json.dumps([before, loaded()]))
"""


@pytest.mark.parametrize("fmu", ["pid_file", "pid_c_file"])
def test_a_simulation_compiles_and_imports_nothing(fmu, request):
    """In an interpreter of its own, in which no other test has compiled anything."""
    file = request.getfixturevalue(fmu)
    command = [sys.executable, "-c", SIMULATION, str(file)]
    finished = subprocess.run(command, capture_output=True, text=True, check=True)
    before, after = json.loads(finished.stdout)
    assert "orchestrator.loop.closed_loop.run" in "".join(before[0])
    assert after == before
