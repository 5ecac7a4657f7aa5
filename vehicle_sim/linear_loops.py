"""PX4's cascade on one axis as linear equations, small angles: what steps should look like, from the gains and the airframe alone.

    m' = (tau - m) / T_m        q' = G m        theta' = q        v' = g theta - (c / M) v
    tau = K (P (q_sp - q) + I int (q_sp - q)) - K D q'        q_sp = P_att (theta_sp - theta)
    theta_sp = (P_v (v_sp - v) + I_v int (v_sp - v) - D_v v') / g

m torque as a share of full, T_m the rotors' lag, G = 4 F_max (arm / sqrt 2) / J, c drag of body and rotors at hover. Continuous in time:
what sampling (400, 200 and 100 Hz) and filters add is left out. Units SI.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.dynamics import GRAVITY_MPS2
from vehicle_sim.parts import AirframeConfig

Array = NDArray[np.float64]
_DT_S = 5e-4


class StepResponse(NamedTuple):
    """Time from a tenth to nine tenths of a step, and overshoot as a share of it."""

    rise_s: float
    overshoot: float

    @classmethod
    def of(cls, shares: Array, dt_s: float) -> "StepResponse":
        """From how much of the step there was at each moment."""
        tenth, nine = (int(np.argmax(shares >= level)) for level in (0.1, 0.9))
        return cls((nine - tenth) * dt_s, max(0.0, float(np.max(shares)) - 1.0))


def linear_step(loop: str, gains: ParameterStore, airframe: AirframeConfig) -> StepResponse:
    """A step of "rate", "attitude" or "velocity", the loops inside it closed."""
    count = {"rate": 800, "attitude": 3000, "velocity": 16_000}[loop]
    state, shares = np.zeros(6), np.zeros(count)
    watched = {"rate": 1, "attitude": 2, "velocity": 3}[loop]
    for k in range(count):
        shares[k] = state[watched]
        state = state + _DT_S * _derivative(state, loop, gains, airframe)
    return StepResponse.of(shares, _DT_S)


def _derivative(state: Array, loop: str, p: ParameterStore, a: AirframeConfig) -> Array:
    m, q, theta, v, rate_integral, velocity_integral = state
    gain = 4.0 * a.max_thrust_n * a.arm_m / sqrt(2.0) / a.inertia_kgm2[0]
    lag_s = (a.motor_time_constant_s + (a.motor_time_constant_down_s or a.motor_time_constant_s)) / 2.0
    rotors_radps = 4.0 * sqrt(a.mass_kg * GRAVITY_MPS2 / 4.0 / a.thrust_coefficient_n_per_radps2)
    drag = a.linear_drag_n_per_mps[0] + a.rotor_drag_n_per_mps_radps * rotors_radps
    v_dot = GRAVITY_MPS2 * theta - drag / a.mass_kg * v
    velocity_error = 1.0 - v
    wanted = p["MPC_XY_VEL_P_ACC"] * velocity_error + velocity_integral - p["MPC_XY_VEL_D_ACC"] * v_dot
    theta_sp = {"rate": 0.0, "attitude": 1.0, "velocity": wanted / GRAVITY_MPS2}[loop]
    q_sp = 1.0 if loop == "rate" else p["MC_ROLL_P"] * (theta_sp - theta)
    q_dot = gain * m
    tau = p["MC_ROLLRATE_K"] * (p["MC_ROLLRATE_P"] * (q_sp - q) + rate_integral - p["MC_ROLLRATE_D"] * q_dot)
    return np.array(
        (
            (tau - m) / lag_s,
            q_dot,
            q,
            v_dot,
            p["MC_ROLLRATE_I"] * (q_sp - q),
            p["MPC_XY_VEL_I_ACC"] * velocity_error if loop == "velocity" else 0.0,
        )
    )
