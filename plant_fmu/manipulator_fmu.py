"""The FMI 2.0 co-simulation slave around the equations: all the state there is, and the FMI life cycle.

This is the module that pythonfmu loads from the FMU's resources. The class must be defined here, not imported:
pythonfmu 0.7.0 miscounts references to an imported one, and the second instance of the FMU crashes.
"""

from __future__ import annotations

from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from flexible_manipulator import coefficients, equilibrium, integrator, kinematics, parameters
from flexible_manipulator.interface import VARIABLES
from pythonfmu import DefaultExperiment, Fmi2Slave, Real
from pythonfmu.enums import Fmi2Causality, Fmi2Initial, Fmi2Status, Fmi2Variability

U_M, U_D, F, Q_M, Q_A, X, Q_M_REF, U_M0, Q_A_START, TABLE = 0, 2, 4, 6, 8, 10, 12, 14, 16, 18
"""Value reference of the first component of each connector; TABLE is where Table 1 begins."""

KIND = {
    "input": {"causality": Fmi2Causality.input, "variability": Fmi2Variability.continuous},
    "output": {
        "causality": Fmi2Causality.output,
        "variability": Fmi2Variability.continuous,
        "initial": Fmi2Initial.calculated,
    },
    "parameter": {
        "causality": Fmi2Causality.parameter,
        "variability": Fmi2Variability.fixed,
        "initial": Fmi2Initial.exact,
    },
    "calculatedParameter": {
        "causality": Fmi2Causality.calculatedParameter,
        "variability": Fmi2Variability.fixed,
        "initial": Fmi2Initial.calculated,
    },
}


class FlexibleManipulator(Fmi2Slave):
    """Two-link planar manipulator on elastic, frictional gears.

    Variables and state live in one array, ``memory``, in which a variable's index is its value reference: the
    getters and setters that pythonfmu generates for single attributes cost about as much as the integration
    itself. ``values`` is the same memory for access to single numbers, which it has at half of NumPy's price.
    """

    description = (
        "Uncertain nonlinear two-link manipulator with elastic gear transmissions "
        "(Moberg, Oehr, Gunnarsson, IFAC World Congress 2008)"
    )

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.default_experiment = DefaultExperiment(start_time=0.0, stop_time=26.0, step_size=0.25e-3)
        self.memory = np.array([variable.start or 0.0 for variable in VARIABLES] + [0.0] * integrator.STATE_SIZE)
        self.values: Any = self.memory.data
        # pythonfmu calls what it finds by that name: machine code, with as little around it as possible.
        step, memory = integrator.do_step, self.memory
        self.do_step = lambda time, size: step(memory, time, size) or self._refuse(time, size)  # type: ignore[method-assign,assignment]
        for reference, variable in enumerate(VARIABLES):
            self.register_variable(
                Real(
                    variable.name,
                    description=variable.description,
                    start=variable.start,
                    getter=lambda reference=reference: self.values[reference],
                    setter=lambda value, reference=reference: self.values.__setitem__(reference, value),
                    **KIND[variable.causality],
                )
            )

    def to_xml(self, model_options: dict[str, str] | None = None) -> Element:
        """The model description, with what this slave can do beyond pythonfmu's defaults."""
        root = super().to_xml(model_options or {})
        capabilities = root.find("CoSimulation")
        assert capabilities is not None
        capabilities.attrib.update(canGetAndSetFMUstate="true", canSerializeFMUstate="true")
        return root

    def get_real(self, vrs: list[int]) -> list[float]:
        values = self.values
        result: list[float] = []
        for vr in vrs:  # a comprehension is a function call of its own before Python 3.12
            result.append(values[vr])
        return result

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        own = self.values
        for vr, value in zip(vrs, values):  # noqa: B905 - a strict zip costs 10 % of the call
            own[vr] = value

    def exit_initialization_mode(self) -> None:
        """Check the parameters, solve the steady state and publish it."""
        values = self.values
        table = dict(
            zip((variable.name for variable in VARIABLES[TABLE:]), values[TABLE : integrator.STATE], strict=True)
        )
        try:
            parameters.check(table)
            arm, joints = coefficients.arm(table), (coefficients.joint(table, 1), coefficients.joint(table, 2))
            integrator.check_substep(table, arm, joints)
        except (ValueError, ArithmeticError) as problem:
            self.log(str(problem), Fmi2Status.error)
            raise
        q_a = (values[Q_A_START], values[Q_A_START + 1])
        rest = equilibrium.solve(arm, joints, q_a)
        self.memory[Q_M : X + 2] = (*rest.q_m, *q_a, *kinematics.tcp(arm, *q_a))
        self.memory[Q_M_REF : U_M0 + 2] = (*rest.q_m, *rest.u_m)
        self.memory[integrator.STATE :] = integrator.state_at_rest(q_a, rest.q_m, arm, joints)
        # A step of no length compiles the step, or loads it from the cache, before the first one that counts.
        self.do_step(0.0, 0.0)

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Integrate eq. (2) over ``step_size`` [s] with the inputs held."""
        return integrator.do_step(self.memory, current_time, step_size)

    def _refuse(self, time: float, size: float) -> bool:
        self.log(integrator.obstacle(self.values, time, size), Fmi2Status.error)
        return False

    def _get_fmu_state(self) -> dict[str, Any]:
        return {"memory": self.memory.tolist()}

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        self.memory[:] = state["memory"]
