"""The rigid body: x_dot = f(x, u; body), its step, and the ground.

State x (13 floats): position n, e, d (m), velocity n, e, d (m/s), attitude q_wb_wxyz, body rates p, q, r (rad/s).
Input u: the rotors' wrench (thrust along -z body, torques about forward, right, down) and the wind (NED, m/s).

    p_dot = v        m v_dot = m g e_d - T R e_z - R D Rᵀ v_rel - c |v_rel| v_rel        v_rel = v - wind
    q_dot = q (0, w) / 2        J w_dot = tau - w x J w
"""

from math import exp, sqrt
from typing import NamedTuple

from vehicle_sim.compiled import inlined
from vehicle_sim.parts import AirframeConfig
from vehicle_sim.rotation import (
    Quaternion,
    Vector,
    normalize,
    quaternion_from_euler,
    quaternion_multiply,
    rotate_back,
    yaw_of,
)
from vehicle_sim.rotors import Wrench

GRAVITY_MPS2 = 9.80665
_FRICTION = 0.8
_SETTLE_S = 0.05


class State(NamedTuple):
    """The 13 numbers of x, or of its derivative."""

    n: float
    e: float
    d: float
    vn: float
    ve: float
    vd: float
    qw: float
    qx: float
    qy: float
    qz: float
    p: float
    q: float
    r: float

    @property
    def position_ned_m(self) -> Vector:
        """Position, NED."""
        return self[0:3]

    @property
    def velocity_ned_mps(self) -> Vector:
        """Velocity, NED."""
        return self[3:6]

    @property
    def q_wb_wxyz(self) -> Quaternion:
        """Attitude, body FRD to NED."""
        return self[6:10]

    @property
    def omega_wb_b_radps(self) -> Vector:
        """Body rates."""
        return self[10:13]


class Body(NamedTuple):
    """Mass, principal moments and drag, taken from the airframe once."""

    mass_kg: float
    inertia_kgm2: Vector
    linear_drag: Vector
    quadratic_drag: float

    @classmethod
    def of(cls, airframe: AirframeConfig) -> "Body":
        """The rigid body of an airframe."""
        return cls(
            airframe.mass_kg, airframe.inertia_kgm2, airframe.linear_drag_n_per_mps, airframe.quadratic_drag_n_per_mps2
        )


def state_at_rest(yaw_rad: float) -> State:
    """Standing level at the local origin."""
    return State(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, *quaternion_from_euler(0.0, 0.0, yaw_rad), 0.0, 0.0, 0.0)


@inlined
def state_derivative(x: State, wrench: Wrench, wind_ned_mps: Vector, body: Body) -> State:
    """f(x, u; body) of the module's equation."""
    _, _, _, vn, ve, vd, w, i, j, k, p, q, r = x
    thrust, roll, pitch, yaw = wrench
    rn, re, rd = vn - wind_ned_mps[0], ve - wind_ned_mps[1], vd - wind_ned_mps[2]
    r11, r12, r13 = 1 - 2 * (j * j + k * k), 2 * (i * j - w * k), 2 * (i * k + w * j)
    r21, r22, r23 = 2 * (i * j + w * k), 1 - 2 * (i * i + k * k), 2 * (j * k - w * i)
    r31, r32, r33 = 2 * (i * k - w * j), 2 * (j * k + w * i), 1 - 2 * (i * i + j * j)
    dx, dy, dz = body.linear_drag
    fx = -dx * (r11 * rn + r21 * re + r31 * rd)
    fy = -dy * (r12 * rn + r22 * re + r32 * rd)
    fz = -dz * (r13 * rn + r23 * re + r33 * rd) - thrust
    c = body.quadratic_drag * sqrt(rn * rn + re * re + rd * rd)
    m = body.mass_kg
    jx, jy, jz = body.inertia_kgm2
    return State(
        vn,
        ve,
        vd,
        (r11 * fx + r12 * fy + r13 * fz - c * rn) / m,
        (r21 * fx + r22 * fy + r23 * fz - c * re) / m,
        (r31 * fx + r32 * fy + r33 * fz - c * rd) / m + GRAVITY_MPS2,
        0.5 * (-i * p - j * q - k * r),
        0.5 * (w * p + j * r - k * q),
        0.5 * (w * q + k * p - i * r),
        0.5 * (w * r + i * q - j * p),
        (roll - (jz - jy) * q * r) / jx,
        (pitch - (jx - jz) * r * p) / jy,
        (yaw - (jy - jx) * p * q) / jz,
    )


@inlined
def advance(x: State, x_dot: State, dt_s: float) -> State:
    """x + dt x_dot, attitude normalised."""
    n, e, d, vn, ve, vd, w, i, j, k, p, q, r = x
    a0, a1, a2, a3, a4, a5, a6, a7, a8, a9, a10, a11, a12 = x_dot
    w, i, j, k = w + dt_s * a6, i + dt_s * a7, j + dt_s * a8, k + dt_s * a9
    scale = 1.0 / sqrt(w * w + i * i + j * j + k * k)
    return State(
        n + dt_s * a0,
        e + dt_s * a1,
        d + dt_s * a2,
        vn + dt_s * a3,
        ve + dt_s * a4,
        vd + dt_s * a5,
        w * scale,
        i * scale,
        j * scale,
        k * scale,
        p + dt_s * a10,
        q + dt_s * a11,
        r + dt_s * a12,
    )


@inlined
def step_free(x: State, wrench: Wrench, wind_ned_mps: Vector, body: Body, dt_s: float) -> State:
    """One midpoint (second-order Runge-Kutta) step in free air, u held."""
    middle = advance(x, state_derivative(x, wrench, wind_ned_mps, body), 0.5 * dt_s)
    return advance(x, state_derivative(middle, wrench, wind_ned_mps, body), dt_s)


@inlined
def rest_on_ground(x: State, dt_s: float) -> State:
    """Keep the body on or above the plane d = 0.

    A body that has sunk below stops there without rebound; friction slows its slide, and its feet turn it level as a damped spring
    does, by its rates, so that a gyroscope feels it: all in proportion to how hard it presses, so that rotors that nearly lift it
    turn it freely. In the air x is returned as it is.
    """
    if x.d < 0.0:
        return x
    vn, ve, vd = x.vn, x.ve, min(0.0, x.vd)
    speed = sqrt(vn * vn + ve * ve)
    load = min(1.0, max(0.0, x.vd) / (GRAVITY_MPS2 * dt_s))
    slide = max(0.0, 1.0 - _FRICTION * load * GRAVITY_MPS2 * dt_s / speed) if speed > 0.0 else 0.0
    keep = exp(-load * dt_s / _SETTLE_S)
    q_wb = (x.qw, x.qx, x.qy, x.qz)
    level = quaternion_from_euler(0.0, 0.0, yaw_of(q_wb))
    w, i, j, k = quaternion_multiply((x.qw, -x.qx, -x.qy, -x.qz), level)
    push = (2.0 if w >= 0.0 else -2.0) * (1.0 - keep) / _SETTLE_S
    p, q, r = x.p * keep + push * i, x.q * keep + push * j, x.r * keep + push * k
    # the rates have changed within the step: half of their change has turned it already
    share = 0.25 * dt_s
    turn = (1.0, share * (p - x.p), share * (q - x.q), share * (r - x.r))
    return State(x.n, x.e, 0.0, vn * slide, ve * slide, vd, *normalize(quaternion_multiply(q_wb, turn)), p, q, r)


@inlined
def specific_force(before: State, after: State, dt_s: float) -> Vector:
    """What an accelerometer feels over a step: Rᵀ ((v' - v) / dt - g), body axes, m/s^2."""
    acceleration = (
        (after.vn - before.vn) / dt_s,
        (after.ve - before.ve) / dt_s,
        (after.vd - before.vd) / dt_s - GRAVITY_MPS2,
    )
    return rotate_back((after.qw, after.qx, after.qy, after.qz), acceleration)
