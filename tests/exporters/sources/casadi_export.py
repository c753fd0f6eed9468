"""Export the continuous PID of both axes with CasADi into the working folder: ContinuousPID.fmu.

The only argument is JSON: K_p, K_i, K_d, tau [s] for each axis, T_s [s], the folder of the FMI 3.0 headers, and the
command of a C compiler.
"""

import json
import sys

from casadi import DaeBuilder

settings = json.loads(sys.argv[1])
dae = DaeBuilder("ContinuousPID")
for i in (0, 1):
    axis = f"[{i + 1}]"
    # Tunable, not fixed: CasADi compiles the start values of fixed parameters into the equations.
    K_p, K_i, K_d = (
        dae.add(name + axis, "parameter", "tunable", {"start": settings[name][i]}) for name in ("K_p", "K_i", "K_d")
    )
    u_m0 = dae.add("u_m0" + axis, "parameter", "tunable", {"start": 0.0})
    # No units: CasADi writes their names without the definitions that FMI asks for.
    reference = dae.add("q_m_ref" + axis, "input", {"start": 0.0})
    measured = dae.add("q_m" + axis, "input", {"start": 0.0})
    filtered = dae.add("x" + axis, "local", "continuous", {"start": 0.0, "initial": "exact"})
    integral = dae.add("s" + axis, "local", "continuous", {"start": 0.0, "initial": "exact"})
    torque = dae.add("u_m" + axis, "output", "continuous", {})
    e = reference - measured
    derivative = (e - filtered) / settings["tau"][i]
    dae.eq(dae.der(filtered), derivative)
    dae.eq(dae.der(integral), e)
    dae.eq(torque, u_m0 + K_p * e + K_i * integral + K_d * derivative)
dae.set_step_size(settings["T_s"])
files = dae.export_fmu({"no_warning": True, "with_serialization": False})
compiler = {"compiler": settings["compiler"], "linker": settings["compiler"]}
how = {"include_dirs": [settings["include"]], "compiler_options": compiler}
dae.pack_fmu(dae.compile_fmu(files, how), {})
