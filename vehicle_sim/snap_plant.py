"""The paper's plant: a quadcopter that takes snap. Feedback linearisation makes r'''' = u and yaw'' = v exactly.

Source: paper, section V, after Rastgoftar et al. 2021 and El Asslouj and Rastgoftar 2023: the rigid body m a = T b3 - m g e3, its thrust
extended by two integrators, so that position has relative degree four. Exact while T > 0 and the tilt stays below 90 deg.
World ENU, body FLU (z up). State: position r, velocity v, attitude R_wb, body rates w, thrust T and its rate T' (two integrators).

    m r'' = T b_3 - m g e_3        R' = R [w]_x        J w' = tau - w x J w        (T)'' = thrust input

    m Rᵀ r'''' = ( 2 T' w_y + T (a_y + w_x w_z),  -2 T' w_x + T (-a_x + w_y w_z),  T'' - T (w_x^2 + w_y^2) ),   a = w'

so the position has relative degree four in (T'', tau_x, tau_y) and the yaw two in tau_z, while T > 0 and the tilt is below 90 deg.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GRAVITY_MPS2 = 9.80665


@dataclass(frozen=True)
class SnapBody:
    """Mass (kg) and principal moments (kg m^2)."""

    mass_kg: float = 2.0
    inertia_kgm2: tuple[float, float, float] = (0.0217, 0.0217, 0.04)


@dataclass(frozen=True)
class SnapState:
    """Position, velocity (3,), R_wb (3, 3), body rates (3,), thrust (N) and its rate (N/s)."""

    position_m: Array
    velocity_mps: Array
    R_wb: Array
    omega_wb_b_radps: Array
    thrust_n: float
    thrust_rate_nps: float


@dataclass(frozen=True)
class PlantInput:
    """What the extended rigid body takes: T'' (N/s^2) and torque (3,) N m."""

    thrust_acceleration_nps2: float
    torque_nm: Array


class SingularPlantError(ValueError):
    """The linearisation does not exist: no thrust, or a tilt of 90 degrees or more."""


def hover_state(position_m: Array, body: SnapBody) -> SnapState:
    """At rest, level, heading east."""
    zero = np.zeros(3)
    return SnapState(np.asarray(position_m, float), zero, np.eye(3), zero, body.mass_kg * GRAVITY_MPS2, 0.0)


def linearising_input(x: SnapState, snap_mps4: Array, yaw_acceleration_radps2: float, body: SnapBody) -> PlantInput:
    """The input that makes r'''' = `snap_mps4` and yaw'' = `yaw_acceleration_radps2`.

    Raises `SingularPlantError` where the thrust is not positive or the body lies on its side.
    """
    T, dT = x.thrust_n, x.thrust_rate_nps
    if T <= 0.0 or x.R_wb[2, 2] <= 0.0:
        raise SingularPlantError(f"thrust {T:.3g} N, cosine of tilt {x.R_wb[2, 2]:.3g}: both must be positive")
    wx, wy, wz = x.omega_wb_b_radps
    f = body.mass_kg * x.R_wb.T @ np.asarray(snap_mps4, float)
    ay = (f[0] - 2.0 * dT * wy) / T - wx * wz
    ax = -(f[1] + 2.0 * dT * wx) / T + wy * wz
    ddT = f[2] + T * (wx * wx + wy * wy)
    az = _yaw_channel(x, ay, yaw_acceleration_radps2)
    J = np.asarray(body.inertia_kgm2)
    w = x.omega_wb_b_radps
    return PlantInput(float(ddT), J * np.array([ax, ay, az]) + np.cross(w, J * w))


def plant_derivative(x: SnapState, u: PlantInput, body: SnapBody) -> SnapState:
    """x_dot of the extended rigid body."""
    J, w = np.asarray(body.inertia_kgm2), x.omega_wb_b_radps
    acceleration = x.thrust_n / body.mass_kg * x.R_wb[:, 2] - np.array([0.0, 0.0, GRAVITY_MPS2])
    return SnapState(
        x.velocity_mps,
        acceleration,
        x.R_wb @ _cross_matrix(w),
        (u.torque_nm - np.cross(w, J * w)) / J,
        x.thrust_rate_nps,
        u.thrust_acceleration_nps2,
    )


def step_snap(x: SnapState, snap_mps4: Array, yaw_acceleration_radps2: float, body: SnapBody, dt_s: float) -> SnapState:
    """One Runge-Kutta step of fourth order of the linearised plant, snap and yaw acceleration held."""

    def f(y: SnapState) -> SnapState:
        return plant_derivative(y, linearising_input(y, snap_mps4, yaw_acceleration_radps2, body), body)

    k1 = f(x)
    k2 = f(_add(x, k1, dt_s / 2))
    k3 = f(_add(x, k2, dt_s / 2))
    k4 = f(_add(x, k3, dt_s))
    moved = _add(_add(_add(_add(x, k1, dt_s / 6), k2, dt_s / 3), k3, dt_s / 3), k4, dt_s / 6)
    U, _, Vt = np.linalg.svd(moved.R_wb)
    return SnapState(
        moved.position_m,
        moved.velocity_mps,
        U @ Vt,
        moved.omega_wb_b_radps,
        moved.thrust_n,
        moved.thrust_rate_nps,
    )


def acceleration_mps2(x: SnapState, body: SnapBody) -> Array:
    """r'' (3,)."""
    return np.asarray(x.thrust_n / body.mass_kg * x.R_wb[:, 2] - np.array([0.0, 0.0, GRAVITY_MPS2]))


def jerk_mps3(x: SnapState, body: SnapBody) -> Array:
    """r''' (3,): (T' b_3 + T w x b_3) / m."""
    wx, wy, _ = x.omega_wb_b_radps
    in_body = np.array([x.thrust_n * wy, -x.thrust_n * wx, x.thrust_rate_nps])
    return np.asarray(x.R_wb @ in_body / body.mass_kg)


def yaw_and_rate(x: SnapState) -> tuple[float, float]:
    """(yaw, yaw rate), radians counter-clockwise from east."""
    roll, pitch, yaw = _angles(x.R_wb)
    _, wy, wz = x.omega_wb_b_radps
    return yaw, float((wy * np.sin(roll) + wz * np.cos(roll)) / np.cos(pitch))


def yaw_matrices(dT_s: float) -> tuple[Array, Array]:
    """(A, B) of the internal dynamics z = (yaw, yaw rate), exact for v held; the paper prints B = [0; 1], without the step."""
    return np.array([[1.0, dT_s], [0.0, 1.0]]), np.array([[dT_s**2 / 2.0], [dT_s]])


def closed_yaw_matrix(k_psi: Array, dT_s: float) -> Array:
    """A_psi (2, 2) of z_{k+1} = A_psi z_k under v_k = k_psi z_k, k_psi (2,)."""
    A, B = yaw_matrices(dT_s)
    return np.asarray(A + B @ np.reshape(k_psi, (1, 2)))


def _yaw_channel(x: SnapState, ay: float, yaw_acceleration: float) -> float:
    """a_z that gives the yaw acceleration: yaw' cos(pitch) = w_y sin(roll) + w_z cos(roll), differentiated."""
    roll, pitch, _ = _angles(x.R_wb)
    wx, wy, wz = x.omega_wb_b_radps
    s, c = np.sin(roll), np.cos(roll)
    yaw_rate = (wy * s + wz * c) / np.cos(pitch)
    pitch_rate = wy * c - wz * s
    roll_rate = wx + np.tan(pitch) * (wy * s + wz * c)
    wanted = yaw_acceleration * np.cos(pitch) - yaw_rate * np.sin(pitch) * pitch_rate
    return float((wanted - ay * s - roll_rate * pitch_rate) / c)


def _angles(R: Array) -> tuple[float, float, float]:
    roll, pitch, yaw = np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(R[2, 0]), np.arctan2(R[1, 0], R[0, 0])
    return float(roll), float(pitch), float(yaw)


def _cross_matrix(w: Array) -> Array:
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def _add(x: SnapState, k: SnapState, h: float) -> SnapState:
    return SnapState(
        x.position_m + h * k.position_m,
        x.velocity_mps + h * k.velocity_mps,
        x.R_wb + h * k.R_wb,
        x.omega_wb_b_radps + h * k.omega_wb_b_radps,
        x.thrust_n + h * k.thrust_n,
        x.thrust_rate_nps + h * k.thrust_rate_nps,
    )
