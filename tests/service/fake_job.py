"""A job that computes nothing: what it does stands in the FMU itself, as JSON behind the beginning of a zip file.

``{"checking": {"kind": "refused", "reason": "..."}}`` is the outcome of a stage. Beside the fields of an outcome, there
are ``wait`` [s], ``exit`` (an exit code without an outcome), ``times`` (how often: afterwards it is done), ``say`` (a
line on standard output) and ``files`` (by their paths in the run's folder).
"""

import json
import os
import sys
import threading
import time
from pathlib import Path


def end() -> None:
    while os.read(0, 1):
        pass
    os._exit(75)


def main() -> None:
    line = b""
    while not line.endswith(b"\n") and (byte := os.read(0, 1)):
        line += byte
    task = json.loads(line)
    threading.Thread(target=end, daemon=True).start()
    stage = task["stage"]
    told = json.loads(Path(task["file"]).read_bytes()[2:]).get(stage, {})
    count = Path(f"{stage}.count")
    before = int(count.read_text()) if count.exists() else 0
    count.write_text(str(before + 1))
    if before >= told.pop("times", 10**9):
        told = {}
    for name, text in told.pop("files", {}).items():
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(text, encoding="utf-8")
    print(json.dumps({"done": 3, "total": 24, "cost": 101.5}), flush=True)
    if line := told.pop("say", ""):
        print(line, flush=True)
    time.sleep(told.pop("wait", 0.0))
    if (code := told.pop("exit", None)) is not None:
        print("cannot go on", file=sys.stderr, flush=True)
        os._exit(code)
    outcome = {"stage": stage, "kind": "done", "verdict": "ok", "cost": 99.5, "holds": True, "disk": 1000, **told}
    scratch = Path(f".{stage}")
    scratch.write_text(json.dumps(outcome))
    scratch.replace(f"{stage}.json")


main()
