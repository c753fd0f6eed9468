"""What the draws of a verification follow from: nothing that a controller could have known."""

import subprocess
import sys
from datetime import datetime, timezone

import pytest
from msgspec import structs
from support.refusals import refusal

from orchestrator.benchmark.draws import QUICKNET, Entropy, fresh, from_beacon
from orchestrator.cli import verify as command
from orchestrator.codec import to_json

SIGNATURE = "b75c69d0b72a5d906e854e808ba7e2accb1542ac355ae486d591aa9d43765482e26cd02df835d3546d23c4b13e0dfc92"
"""Of round 123 of quicknet, as drand's own libraries have it among their examples."""

ROUND = f"drand:{QUICKNET}:123:{SIGNATURE}"
BEFORE = "2023-08-23T15:15:32Z"


def test_fresh_draws_have_256_bits_that_differ():
    one, other = fresh(), fresh()
    assert one != other and one.problem == "" and len(bytes.fromhex(one.value)) == 32


@pytest.mark.parametrize("text", [ROUND, to_json({"round": 123, "signature": SIGNATURE})])
def test_a_round_of_the_beacon_gives_the_bits_of_its_signature(text):
    found = from_beacon(text, BEFORE)
    assert found.value == "fb8f7bc29bf24db51871ec8c79f3a1e4bd0557bc0dfcee9ed1d924e69d1c60dc"
    assert found.beacon.time == datetime(2023, 8, 23, 15, 15, 33, tzinfo=timezone.utc)
    assert (found.source, found.problem) == ("beacon", "")


@pytest.mark.needs("py_ecc")
def test_its_signature_is_checked():
    assert from_beacon(ROUND, BEFORE).beacon.checked
    for wrong in (ROUND.replace(":123:", ":124:"), ROUND[:-1] + "3", f"drand:{QUICKNET}:123:{'0' * 96}"):
        assert refusal(from_beacon, wrong, BEFORE).what == "wrong-signature"


AFTER_A_CHECK = """
import json, sys
from orchestrator.benchmark.draws import from_beacon
assert from_beacon(sys.argv[1], sys.argv[2]).beacon.checked
try:
    json.loads("[" * 200_000)
except RecursionError:
    print("refused")
"""


@pytest.mark.needs("py_ecc")
def test_a_check_leaves_deep_files_refused():
    words = [sys.executable, "-c", AFTER_A_CHECK, ROUND, BEFORE]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.stdout == "refused\n", done


@pytest.mark.parametrize(
    ("text", "published", "what"),
    [
        ("2027-01-01", BEFORE, "no-beacon"),
        ("today", BEFORE, "no-beacon"),
        ("", BEFORE, "no-beacon"),
        ("{}", BEFORE, "no-beacon"),
        ("[]", BEFORE, "no-beacon"),
        (ROUND[:-1], BEFORE, "no-beacon"),
        (ROUND.replace(QUICKNET, "0" * 64), BEFORE, "no-beacon"),
        (to_json({"round": 123, "signature": SIGNATURE, "randomness": "0" * 64}), BEFORE, "no-beacon"),
        (to_json({"round": "123", "signature": SIGNATURE}), BEFORE, "no-beacon"),
        (ROUND, "2023-08-23T15:15:33Z", "early-beacon"),
        (ROUND, "2023-08-23T17:15:32+02:00", ""),
        (ROUND, "yesterday", "no-time"),
        (ROUND, "", "no-time"),
    ],
)
def test_what_may_have_been_known_is_refused(text, published, what):
    if what:
        assert refusal(from_beacon, text, published).what == what
    else:
        assert from_beacon(text, published).problem == ""


def test_entropy_that_contradicts_itself_is_noticed():
    good = from_beacon(ROUND, BEFORE)
    beacon = good.beacon
    for wrong in (
        Entropy("0" * 63),
        Entropy("A" * 64),
        structs.replace(good, value="0" * 64),
        structs.replace(good, source="fresh"),
        structs.replace(good, beacon=None),
        structs.replace(good, beacon=structs.replace(beacon, chain="0" * 64)),
        structs.replace(good, beacon=structs.replace(beacon, signature="x" * 96)),
        structs.replace(good, beacon=structs.replace(beacon, round=2**52)),
        structs.replace(good, beacon=structs.replace(beacon, published="2027-01-01")),
    ):
        assert wrong.problem


def test_a_round_goes_with_the_time_of_publication(quick_pid_file, tmp_path):
    for words in (["--draws", ROUND], ["--published", BEFORE]):
        assert refusal(command.main, [str(quick_pid_file), *words]).what == "contradiction"
    given = [str(quick_pid_file), "--draws", "2027-01-01", "--published", BEFORE, "--output-dir", str(tmp_path)]
    assert refusal(command.main, given).what == "no-beacon"
