"""Controllers that want a better score than they deserve: the paper's PID with a cheat around it, in Python or C.

Each gains, or may, where it shares a process with plant and judge; ``test_verify.py`` tries them where it does not.
"""

from pathlib import Path

from support.tools import require

from controller_fmu.export import c_fmu, python_fmu

ROOT = Path(__file__).resolve().parents[2] / "controller_fmu"
PID_C, PID = ROOT / "pid_c", ROOT / "pid" / "diagonal_pid_fmu.py"

SCRIPT = """
import fcntl, glob, os, shutil, stat, sys, tempfile
from diagonal_pid_fmu import UNITS, DiagonalPID, Q_M, Q_M_REF, U_M, U_M0

HERE = os.path.dirname(__file__)
F_SETPIPE_SZ, F_GETPIPE_SZ = 1031, 1032


def variable(name):
    "A local variable of whoever has called."
    frame = sys._getframe()
    while frame and name not in frame.f_locals:
        frame = frame.f_back
    return frame and frame.f_locals[name]


class Cheat(DiagonalPID):
    def setup_experiment(self, start, stop, tolerance):
        self.stop = stop

    def do_step(self, t, h):
        x = self._values
{body}
        return super().do_step(t, h)
"""

BODIES = {
    "monkeypatch": """
        judge = sys.modules.get("orchestrator.benchmark.one_pass")
        if judge and t == 0.0:
            honest, nothing = judge.scan, dict(noise=(0.0, 0.0), torque=(0.0, 0.0), force_error=0.0, chirp_error=0.0)
            judge.scan = lambda *given: honest(*given)._replace(settling=-1, **nothing)
""",
    "stop-time": """
        if self.stop < 20.0:
            x[Q_M:Q_M + 2] = x[Q_M_REF:Q_M_REF + 2]
""",
    "plant-state": """
        record = variable("record")
        if record is not None:
            x[Q_M:Q_M + 2] = record.outputs[round(t / h), :2]
""",
    "forged": """
        task = variable("task")
        if t > 0.1 and hasattr(task, "protocol"):
            from orchestrator.pairing.work import Digested, expected
            from orchestrator.benchmark.results import Judgement, Measurements
            from orchestrator.codec import pack
            from orchestrator.execution.messages import Finished, frame
            names = expected(task.protocol, task.case)
            told = Measurements(**{name: True if name == "settled" else 0.0 for name in names})
            value = Judgement(status="done", time=float(task.case.scenario.duration), measurements=told)
            if variable("work").__name__ in ("digest_case", "begin_case"):
                value = Digested(value, bytes(32))
            value = pack(value)
            os.write(variable("channel"), frame(Finished(variable("index"), value, 0.1)))
            os._exit(0)
        elif t > 0.1:
            for descriptor in range(3, 64):
                try:
                    os.write(descriptor, bytes(64))
                except OSError:
                    pass
""",
    "replaced-plant": """
        if t == 0.0:
            cache = os.path.dirname(os.path.dirname(os.path.dirname(HERE)))
            for file in glob.glob(os.path.join(cache, "built", "**", "FlexibleManipulator*.fmu"), recursive=True):
                shutil.copyfile(os.path.join(HERE, "other.txt"), file)  # no copy(): it sets the mode, which is refused
""",
    "marked-descriptors": """
        if t == 0.0:
            self.known = False
            for mark in (False, True):  # first all are read: two may be of the same pipe
                for descriptor in range(64):
                    try:
                        if stat.S_ISCHR(os.fstat(descriptor).st_mode) and os.getcwd() != "/tmp/.flexible-manipulator":
                            continue  # a device of this machine, which would stay as it is left
                        if mark:
                            os.fchmod(descriptor, 0o751)
                            fcntl.fcntl(descriptor, F_SETPIPE_SZ, 8192)
                        else:
                            self.known |= os.fstat(descriptor).st_mode & 0o777 == 0o751
                            self.known |= fcntl.fcntl(descriptor, F_GETPIPE_SZ) == 8192
                    except OSError:
                        pass
        if self.known:
            x[Q_M:Q_M + 2] = x[Q_M_REF:Q_M_REF + 2]
""",
    "left-files": """
        if t == 0.0:
            places = [os.path.join(HERE, "seen"), "/dev/shm/seen-%d" % os.getuid()]
            places += [os.path.join(tempfile.gettempdir(), "seen"), "seen"]
            self.known = any(map(os.path.exists, places))
            for place in places:
                try:
                    open(place, "w").close()
                except OSError:
                    pass
        if self.known:
            x[Q_M:Q_M + 2] = x[Q_M_REF:Q_M_REF + 2]
""",
    "replay": """
        plan = PLANS.get((x[U_M0], x[U_M0 + 1]))
        if plan and plan[0] <= t < plan[1]:
            x[Q_M:Q_M + 2] = [x[Q_M + i] + plan[2 + i] for i in (0, 1)]
""",
}
"""What the controllers in Python do before each step, by name."""

DEFINES = {"interpreter": "CHEAT_PYTHON", "maps": "CHEAT_MAPS", "rounding": "CHEAT_ROUNDING"}
"""Those in C."""


def cheat(folder: Path, name: str, head: str = "", other: bytes = b"") -> Path:
    """Build the cheat ``name``; ``head`` are lines before those in Python, ``other`` a file that travels with it.

    The test is skipped where it is one in C and there is no compiler.
    """
    sources = folder / name
    sources.mkdir(parents=True)
    target = folder / f"{name.replace('-', '_')}.fmu"
    if name in DEFINES:
        require("compiler")
        (sources / "honest.h").write_text((PID_C / "model.c").read_text())
        (sources / "cheat.c").write_text(
            f"#define {DEFINES[name]}\n" + Path(__file__).with_name("cheats.c").read_text()
        )
        return c_fmu(
            [sources / "cheat.c", sources / "honest.h", PID_C / "pid.c", PID_C / "pid.h"],
            PID_C / "modelDescription.xml",
            target,
        )
    script = sources / "cheat.py"
    script.write_text(head + SCRIPT.replace("{body}", BODIES[name]))
    (sources / "other.txt").write_bytes(other)
    return python_fmu(script, [PID, sources / "other.txt"], script.stem, target)
