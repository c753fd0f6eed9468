"""A Python controller that goes wrong: what ``fault`` says, from the time ``at`` [s] on."""

import os
import socket
import subprocess
import sys

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

PAIRS = {"q_m_ref": "rad", "q_m": "rad", "u_m": "N.m", "u_m0": "N.m"}
UNITS = {"fault": "1", "at": "s"} | {f"{name}_{axis}": unit for name, unit in PAIRS.items() for axis in (1, 2)}

RAISE, EXIT, SYSTEM_EXIT, SPAWN, RECURSE, REPORT = range(1, 7)


class HostileSlave(Fmi2Slave):
    """u_m = u_m0 + q_m_ref - q_m, until the fault strikes."""

    author = "tests"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        kinds = {"q_m_ref": "input", "q_m": "input", "u_m": "output", "u_m0": "parameter"}
        for name, kind in kinds.items():
            for axis in (1, 2):
                variability = Fmi2Variability.fixed if kind == "parameter" else Fmi2Variability.continuous
                setattr(self, f"{name}_{axis}", 0.0)
                self.register_variable(
                    Real(f"{name}_{axis}", causality=Fmi2Causality[kind], variability=variability, start=0.0)
                    if kind != "output"
                    else Real(f"{name}_{axis}", causality=Fmi2Causality.output)
                )
        self.fault, self.at = 0.0, 0.0
        for name in ("fault", "at"):
            self.register_variable(
                Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed, start=0.0)
            )

    def do_step(self, current_time, step_size):
        """One sample."""
        if self.fault and current_time >= self.at - 1e-9:
            self.strike()
        for axis in (1, 2):
            error = getattr(self, f"q_m_ref_{axis}") - getattr(self, f"q_m_{axis}")
            setattr(self, f"u_m_{axis}", getattr(self, f"u_m0_{axis}") + error)
        return True

    def strike(self):
        """Go wrong."""
        if self.fault == RAISE:
            raise RuntimeError("the slave has lost its mind")
        if self.fault == EXIT:
            os._exit(7)
        if self.fault == SYSTEM_EXIT:
            sys.exit("leaving")
        if self.fault == SPAWN:
            sleeper = subprocess.Popen(["sleep", "1000"], start_new_session=True)
            with open(os.path.join(os.path.dirname(__file__), "daemon.pid"), "w") as file:
                file.write(str(sleeper.pid))
            self.fault = 0.0
        if self.fault == RECURSE:
            self.strike()
        if self.fault == REPORT:
            raise RuntimeError("; ".join(report()))


def report():
    """What this process is allowed to do."""
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
    listening = socket.socket()
    interfaces = {name for _, name in socket.if_nameindex()}
    listening.close()
    yield f"network: {'refused' if interfaces <= {'lo'} else 'there'}"
    count = sum(entry.isdigit() for entry in os.listdir("/proc"))
    yield f"processes: {'3 or fewer' if count <= 3 else 'all'}"
