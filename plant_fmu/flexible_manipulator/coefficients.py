"""The constants of the equations of motion, gathered from Table 1."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Arm(NamedTuple):
    """Constants of the rigid-body equations (3), (9) and (11); SI units."""

    a_1: float
    """j_1 + m_1 xi_1^2 + j_2 + m_2 (l_1^2 + xi_2^2), the constant part of (3b) [kg.m2]."""
    a_2: float
    """j_2 + m_2 xi_2^2, eq. (3d) [kg.m2]."""
    b: float
    """m_2 l_1 xi_2, the coupling in (3b), (3c) and (3h) [kg.m2]."""
    c_1: float
    """g (m_1 xi_1 + m_2 l_1), eq. (3f) [N.m]."""
    c_2: float
    """g m_2 xi_2, eq. (3f)-(3g) [N.m]."""
    l_1: float
    """Length of link 1, eq. (9) [m]."""
    l_2: float
    """Length of link 2, eq. (9) [m]."""
    det: float
    """(a_1 - a_2) a_2, the determinant of the inertia matrix (3b)-(3d) at sin q_a2 = 0 [kg2.m4]."""


class Joint(NamedTuple):
    """Constants of one motor and its gear, eq. (4)-(8); SI units."""

    per_j_m: float
    """1 / j_m [1/(kg.m2)]."""
    per_n: float
    """1 / n."""
    gamma: float
    d: float
    k_1: float
    """Linear stiffness (5c) [N.m/rad]."""
    k_3: float
    """Cubic stiffness (5d) [N.m/rad3]."""
    psi: float
    m_0: float
    """Torque at the breakpoint (5e) [N.m]."""
    m_1: float
    """Stiffness beyond the breakpoint (5f) [N.m/rad]."""
    f_d: float
    f_k: float
    """f_c mu_k, the kinetic friction of (8) [N.m]."""
    f_s: float
    """2 f_c (1 - mu_k), twice what the static friction of (8) is above the kinetic one [N.m]."""
    beta: float
    alpha: float


def arm(parameters: Mapping[str, float]) -> Arm:
    """Rigid-body constants from the parameters of Table 1 (FMI names, SI units)."""
    j_1, j_2 = parameters["j[1]"], parameters["j[2]"]
    m_1, m_2 = parameters["m[1]"], parameters["m[2]"]
    l_1, l_2 = parameters["l[1]"], parameters["l[2]"]
    xi_1, xi_2 = parameters["xi[1]"], parameters["xi[2]"]
    g = parameters["g"]
    a_1 = j_1 + m_1 * (xi_1 * xi_1) + j_2 + m_2 * (l_1 * l_1 + xi_2 * xi_2)
    a_2 = j_2 + m_2 * (xi_2 * xi_2)
    return Arm(
        a_1=a_1,
        a_2=a_2,
        b=m_2 * l_1 * xi_2,
        c_1=g * (m_1 * xi_1 + m_2 * l_1),
        c_2=g * m_2 * xi_2,
        l_1=l_1,
        l_2=l_2,
        det=(a_1 - a_2) * a_2,
    )


def joint(parameters: Mapping[str, float], axis: int) -> Joint:
    """Motor and gear constants of ``axis`` (1 or 2) from the parameters of Table 1 (FMI names, SI units)."""

    def of(symbol: str) -> float:
        return parameters[f"{symbol}[{axis}]"]

    k_low, k_high, psi = of("k_low"), of("k_high"), of("psi")
    k_3 = (k_high - k_low) / (3.0 * (psi * psi))
    f_c, mu_k = of("f_c"), of("mu_k")
    return Joint(
        per_j_m=1.0 / of("j_m"),
        per_n=1.0 / of("n"),
        gamma=of("gamma"),
        d=of("d"),
        k_1=k_low,
        k_3=k_3,
        psi=psi,
        m_0=k_low * psi + k_3 * (psi * psi * psi),
        m_1=k_high,
        f_d=of("f_d"),
        f_k=f_c * mu_k,
        f_s=2.0 * f_c * (1.0 - mu_k),
        beta=of("beta"),
        alpha=of("alpha"),
    )


def sticking(joint: Joint) -> float:
    """Slope f_d + alpha f_c of the motor friction (8) at zero speed [N.m.s/rad]."""
    return joint.f_d + joint.alpha * (joint.f_k + 0.5 * joint.f_s)
