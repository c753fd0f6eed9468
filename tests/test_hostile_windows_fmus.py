"""Hostile controllers for Windows: each costs itself, the next one works, and nothing of Wine is left."""

import time

import pytest
from hostile.runs import HANG_LIMIT, STRUCK, bench, run, short_cases
from hostile.windows import left_of_wine, library, windows_fmu

from orchestrator.execution import worker_life
from orchestrator.execution.job import Limits

pytestmark = pytest.mark.needs("wine", "mingw", "x86_64-linux")

LOST, GONE = "process under Wine", "ended by itself with exit code"

FAULTS = {
    "main-crash": ("error", "error 998 of Windows"),
    "main-exit": ("crashed", GONE),
    "main-no": ("error", "cannot be loaded under Wine"),
    "instantiate-no": ("error", "instantiation failed"),
    "instantiate-abort": ("crashed", GONE),
    "step-crash": ("crashed", "exception 0xC0000005"),
    "step-exit": ("crashed", f"{GONE} 0"),
    "step-kill": ("crashed", f"{GONE} 7"),
    "step-abort": ("crashed", GONE),
    "step-divide": ("crashed", "exception 0xC0000094"),
    "step-raise": ("crashed", "exception 0xE0000001"),
    "step-overflow": ("crashed", LOST),
    "step-thread": ("crashed", "exception 0xC0000005"),
    "step-rounding": ("error", "rounding upward"),
    "step-denormal": ("error", "denormal numbers are zero"),
    "step-nan": ("error", "not a number"),
    "step-discard": ("error", "no: why?"),
    "step-status": ("error", "illegal status 77"),
    "step-noise": ("crashed", LOST),
    "step-close": ("crashed", LOST),
    "step-print": ("crashed", "printed or logged more than"),
    "step-log": ("crashed", "printed or logged more than"),
    "step-memory": ("crashed", "of memory; the limit is"),
    "step-child": ("done", ""),
    "step-window": ("done", ""),
    "terminate-crash": ("crashed", "exception 0xC0000005"),
    "free-exit": ("crashed", GONE),
}
"""Status and words of the message."""

HANGS = ("main-hang", "main-wait", "step-hang", "step-wait")


def outcome(plant, file, limit=60.0, **changes):
    (found,) = run(bench(plant, file, limit, **changes), short_cases((STRUCK,)))
    return found.result.status.value, found.result.message


def no_wine_left():
    """Nothing is left, at the latest in a second: who ends a worker does not wait for all that it has started."""
    end = time.monotonic() + 1.0
    while (left := left_of_wine()) and time.monotonic() < end:
        time.sleep(0.05)
    return not left


@pytest.fixture(scope="module", autouse=True)
def sound(native_plant_file, fmu_folder):
    """After all of them, one without a fault works."""
    yield
    assert outcome(native_plant_file, windows_fmu(fmu_folder)) == ("done", "") and no_wine_left()


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_has_its_status(fault, native_plant_file, tmp_path):
    status, words = FAULTS[fault]
    found, message = outcome(native_plant_file, windows_fmu(tmp_path, fault), limits=Limits(600 * 1024**2, 2 * 1024**2))
    assert (found, words in message) == (status, True), message
    assert found != "crashed" or "of the controller at t =" in message, message
    assert no_wine_left()


@pytest.mark.parametrize("fault", HANGS)
def test_a_hang_is_a_timeout(fault, native_plant_file, tmp_path, no_slack, monkeypatch):
    monkeypatch.setattr(worker_life, "START_TIMEOUT", 2.0)
    found, message = outcome(native_plant_file, windows_fmu(tmp_path, fault), HANG_LIMIT)
    assert found == "timeout", message
    assert no_wine_left()


@pytest.mark.parametrize("missing", ["MISSING1.dll", "python3.dll"])
def test_a_library_that_it_misses_is_named(missing, native_plant_file, tmp_path):
    content = library().replace(b"USER32.dll\0", missing.encode()[:10].ljust(11, b"\0"))
    found, message = outcome(native_plant_file, windows_fmu(tmp_path, content=content))
    assert found == "error" and missing[:10] in message, message
