"""Drive a controller FMU of FMI 2.0 or 3.0 co-simulation through FMPy's low-level classes, in a child process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from pid_fmus import T_S, in_child, instance_arguments

from .recipe import Ports, Recipe

Pair = tuple[float, float]


@dataclass(frozen=True)
class Errors:
    """Position errors of both axes [rad]; the reference is held at the error, the measurement at zero, so that
    the subtraction in the controller is exact."""

    initial: Pair
    """While the FMU initializes."""
    samples: tuple[Pair, ...]
    """One a step."""


def torques(recipe: Recipe, folder: Path, errors: Errors, u_m0: Pair) -> list[Pair]:
    """Return u_m [N.m] after initialization and after each step of T_s."""
    angle, torque = recipe.angle_unit, recipe.torque_unit
    scaled = Errors(_divided(errors.initial, angle), tuple(_divided(e, angle) for e in errors.samples))
    seen = in_child(_drive, recipe.build(folder), recipe.ports, scaled, _divided(u_m0, torque))
    return [(first * torque, second * torque) for first, second in seen]


def _divided(pair: Pair, unit: float) -> Pair:
    return pair[0] / unit, pair[1] / unit


def _drive(path: Path, ports: Ports, errors: Errors, u_m0: Pair) -> list[Pair]:
    access = _open(path)
    seen: list[Pair] = []
    access.begin()
    access.set(ports.u_m0, u_m0)
    access.set(ports.q_m, (0.0, 0.0))
    access.set(ports.q_m_ref, errors.initial)
    access.slave.exitInitializationMode()
    seen.append(access.get(ports.u_m))
    for k, error in enumerate(errors.samples):
        access.set(ports.q_m_ref, error)
        access.slave.doStep(k * T_S, T_S)
        seen.append(access.get(ports.u_m))
    access.slave.terminate()
    access.slave.freeInstance()
    return seen


@dataclass(frozen=True)
class _Access:
    """An instance whose variables go by name, whatever its FMI version and the variables' type."""

    slave: Any
    begin: Callable[[], None]
    variables: dict[str, Any]

    def set(self, names: Sequence[str], values: Pair) -> None:
        getattr(self.slave, f"set{self._type(names)}")(self._references(names), values)

    def get(self, names: Sequence[str]) -> Pair:
        arguments = {"nValues": 2} if isinstance(self.slave, FMU3Slave) else {}
        first, second = getattr(self.slave, f"get{self._type(names)}")(self._references(names), **arguments)
        return first, second

    def _references(self, names: Sequence[str]) -> list[int]:
        return [self.variables[name].valueReference for name in names]

    def _type(self, names: Sequence[str]) -> str:
        return str(self.variables[names[0]].type)


def _open(path: Path) -> _Access:
    description = fmpy.read_model_description(str(path))
    variables = {variable.name: variable for variable in description.modelVariables}
    if description.fmiVersion == "2.0":
        slave = FMU2Slave(**instance_arguments(path))
        slave.instantiate()
        return _Access(slave, partial(_begin2, slave), variables)
    slave = FMU3Slave(**instance_arguments(path))
    slave.instantiate()
    return _Access(slave, partial(slave.enterInitializationMode, startTime=0.0), variables)


def _begin2(slave: FMU2Slave) -> None:
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
