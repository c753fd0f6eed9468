"""What the process of a controller is allowed to do; travels with the controller of ``test_sandbox.py``."""

import os
import socket


def report():
    """The findings, in words."""
    files = {
        "home": os.path.expanduser("~/written-by-a-hostile-slave"),
        "own folder": os.path.join(os.path.dirname(__file__), "written.txt"),
        "temporary files": "/tmp/written-by-a-hostile-slave",
    }
    for name, path in files.items():
        try:
            with open(path, "w") as file:
                file.write("ha")
            os.remove(path)
            yield f"{name}: written"
        except OSError as problem:
            yield f"{name}: refused ({problem.strerror})"
    interfaces = {name for _, name in socket.if_nameindex()}
    yield f"network: {'refused' if interfaces <= {'lo'} else 'there'}"
    count = sum(entry.isdigit() for entry in os.listdir("/proc"))
    yield f"processes: {'3 or fewer' if count <= 3 else 'all'}"
