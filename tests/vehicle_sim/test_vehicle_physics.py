"""Laws of the rigid body, rotors, wind, battery and sensors."""

from math import cos, exp, hypot, pi, radians, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_sim.battery import Pack, fresh_battery, open_circuit_cell_v, step_battery, top_speed_fraction
from vehicle_sim.dynamics import (
    GRAVITY_MPS2,
    Body,
    State,
    rest_on_ground,
    specific_force,
    state_at_rest,
    state_derivative,
    step_free,
)
from vehicle_sim.estimator import turned
from vehicle_sim.geo import Geodetic, GeoFrame
from vehicle_sim.noise import NoiseTable
from vehicle_sim.parts import AirframeConfig, BatteryConfig, HomeConfig, SensorsConfig, WindConfig
from vehicle_sim.rotation import (
    enu_flu_from_ned_frd,
    euler_from_quaternion,
    quaternion_from_axes,
    quaternion_from_euler,
    quaternion_multiply,
    rotate,
    rotate_back,
    yaw_of,
)
from vehicle_sim.rotors import Demand, RotorModel, Wrench, lag_speeds, mix, rotor_wrench, speed_targets, unmix
from vehicle_sim.sensors import ErrorModel, EstimateError, next_error, pressure_altitude_m, pressure_hpa
from vehicle_sim.wind import WindModel, next_value

CALM = (0.0, 0.0, 0.0)
NO_DRAG = AirframeConfig(linear_drag_n_per_mps=(0.0, 0.0, 0.0), quadratic_drag_n_per_mps2=0.0)
angle = st.floats(-3.0, 3.0)
steep = st.floats(-1.4, 1.4)
number = st.floats(-10.0, 10.0)
unit = st.floats(-1.0, 1.0)


def airborne(**changes: float) -> State:
    return state_at_rest(0.0)._replace(d=-100.0, **changes)


def fly(
    x: State, wrench: Wrench, body: Body, duration_s: float, dt_s: float, wind: tuple[float, float, float] = CALM
) -> State:
    for _ in range(round(duration_s / dt_s)):
        x = step_free(x, wrench, wind, body, dt_s)
    return x


def test_thrust_equal_to_weight_hovers() -> None:
    body = Body.of(AirframeConfig())
    hover = Wrench(body.mass_kg * GRAVITY_MPS2, 0.0, 0.0, 0.0)
    assert fly(airborne(), hover, body, 2.0, 0.0025) == pytest.approx(airborne(), abs=1e-12)


def test_free_fall_without_drag() -> None:
    x = fly(airborne(vn=3.0), Wrench(0, 0, 0, 0), Body.of(NO_DRAG), 2.0, 0.0025)
    assert x.d == pytest.approx(-100.0 + 0.5 * GRAVITY_MPS2 * 4.0, abs=1e-9)
    assert x.n == pytest.approx(6.0, abs=1e-9)
    assert x.vd == pytest.approx(2 * GRAVITY_MPS2, abs=1e-9)


def test_terminal_speed_balances_drag_and_weight() -> None:
    config = AirframeConfig()
    x = fly(airborne()._replace(d=-1e5), Wrench(0, 0, 0, 0), Body.of(config), 60.0, 0.01)
    drag = config.linear_drag_n_per_mps[2] * x.vd + config.quadratic_drag_n_per_mps2 * x.vd**2
    assert drag == pytest.approx(config.mass_kg * GRAVITY_MPS2, rel=1e-6)


def test_drag_takes_energy_and_wind_carries_the_body_along() -> None:
    body = Body.of(AirframeConfig())
    hover = Wrench(body.mass_kg * GRAVITY_MPS2, 0.0, 0.0, 0.0)
    slower = fly(airborne(vn=5.0, ve=-3.0), hover, body, 1.0, 0.0025)
    assert hypot(slower.vn, slower.ve) < hypot(5.0, 3.0)
    carried = fly(airborne(), hover, body, 200.0, 0.01, wind=(4.0, -2.0, 0.0))
    assert (carried.vn, carried.ve) == pytest.approx((4.0, -2.0), abs=0.01)


@given(roll=angle, pitch=steep, yaw=angle, vn=number, ve=number, vd=number)
def test_drag_never_adds_energy(roll: float, pitch: float, yaw: float, vn: float, ve: float, vd: float) -> None:
    x = State(0, 0, -10, vn, ve, vd, *quaternion_from_euler(roll, pitch, yaw), 0, 0, 0)
    x_dot = state_derivative(x, Wrench(0, 0, 0, 0), CALM, Body.of(AirframeConfig()))
    power = vn * x_dot.vn + ve * x_dot.ve + vd * (x_dot.vd - GRAVITY_MPS2)
    assert power <= 1e-12


def test_torque_free_rotation_keeps_energy_and_angular_momentum() -> None:
    airframe = AirframeConfig(inertia_kgm2=(0.02, 0.03, 0.045))
    body = Body.of(airframe)
    x0 = airborne(p=3.0, q=0.4, r=-2.0)
    J = np.array(airframe.inertia_kgm2)

    def momentum(x: State) -> np.ndarray:
        return np.array(rotate(x.q_wb_wxyz, tuple(J * np.array(x.omega_wb_b_radps))))

    def energy(x: State) -> float:
        return float(J @ np.array(x.omega_wb_b_radps) ** 2 / 2)

    x1 = fly(x0, Wrench(0, 0, 0, 0), body, 5.0, 0.0005)
    assert momentum(x1) == pytest.approx(momentum(x0), abs=2e-5)
    assert energy(x1) == pytest.approx(energy(x0), rel=1e-5)
    assert abs(x1.q - x0.q) > 0.05


def test_integrator_is_of_second_order() -> None:
    body = Body.of(AirframeConfig(inertia_kgm2=(0.02, 0.03, 0.045)))
    x0 = airborne(p=2.0, q=1.0, r=-2.0, vn=8.0)
    wrench = Wrench(25.0, 0.01, -0.02, 0.005)
    exact = np.array(fly(x0, wrench, body, 0.4, 0.0001))
    errors = [float(np.abs(np.array(fly(x0, wrench, body, 0.4, h)) - exact).max()) for h in (0.004, 0.002)]
    assert 3.5 < errors[0] / errors[1] < 4.6


def test_signs_of_rotors_by_hand() -> None:
    rotors = RotorModel.of(AirframeConfig())
    front_right, rear_left, front_left, rear_right = (
        rotor_wrench(tuple(100.0 if i == k else 0.0 for i in range(4)), rotors) for k in range(4)
    )
    assert front_right.roll_nm < 0 < front_right.pitch_nm  # right side up rolls left, nose up
    assert rear_left.roll_nm > 0 > rear_left.pitch_nm
    assert front_left.roll_nm > 0
    assert front_left.pitch_nm > 0
    assert rear_right.roll_nm < 0
    assert rear_right.pitch_nm < 0
    assert front_right.yaw_nm > 0  # counter-clockwise rotor turns the body clockwise, which is positive in FRD
    assert rear_left.yaw_nm > 0 > front_left.yaw_nm


def test_nose_down_accelerates_north_and_roll_right_accelerates_east() -> None:
    body = Body.of(AirframeConfig())
    hover = Wrench(body.mass_kg * GRAVITY_MPS2, 0, 0, 0)
    nose_down = airborne()._replace(
        **dict(zip(("qw", "qx", "qy", "qz"), quaternion_from_euler(0, -0.1, 0), strict=True))
    )
    rolled = airborne()._replace(**dict(zip(("qw", "qx", "qy", "qz"), quaternion_from_euler(0.1, 0, 0), strict=True)))
    assert state_derivative(nose_down, hover, CALM, body).vn == pytest.approx(GRAVITY_MPS2 * 0.0998, rel=1e-3)
    assert state_derivative(rolled, hover, CALM, body).ve == pytest.approx(GRAVITY_MPS2 * 0.0998, rel=1e-3)


@given(thrust=st.floats(0.45, 0.55), roll=st.floats(-0.1, 0.1), pitch=st.floats(-0.1, 0.1), yaw=st.floats(-0.1, 0.1))
def test_mixing_inverts_inside_the_limits_and_matches_the_wrench(
    thrust: float, roll: float, pitch: float, yaw: float
) -> None:
    demand = Demand(thrust, roll, pitch, yaw)
    fractions = mix(demand)
    assert unmix(fractions) == pytest.approx(demand, abs=1e-12)
    config = AirframeConfig()
    rotors = RotorModel.of(config)
    wrench = rotor_wrench(speed_targets(fractions, rotors.max_speed_radps, rotors.max_speed_radps), rotors)
    full = 4 * config.max_thrust_n
    lever = config.arm_m / sqrt(2)
    expected = (thrust * full, roll * full * lever, pitch * full * lever, yaw * full * config.torque_coefficient_m)
    assert wrench == pytest.approx(expected, abs=1e-9)


@given(thrust=st.floats(0, 1), roll=unit, pitch=unit, yaw=unit)
def test_saturated_mixing_keeps_roll_and_pitch_first(thrust: float, roll: float, pitch: float, yaw: float) -> None:
    fractions = mix(Demand(thrust, roll, pitch, yaw))
    assert all(0.0 <= f <= 1.0 for f in fractions)
    got = unmix(fractions)
    share = min(1.0, 1.0 / (2 * (abs(roll) + abs(pitch)))) if roll or pitch else 1.0
    assert (got.roll, got.pitch) == pytest.approx((share * roll, share * pitch), abs=1e-9)
    assert abs(got.yaw) <= abs(yaw) + 1e-12
    assert got.yaw * yaw >= -1e-12


def test_rotor_lag_reaches_63_percent_in_one_time_constant() -> None:
    speeds = (0.0, 0.0, 0.0, 0.0)
    for _ in range(8):
        speeds = lag_speeds(speeds, (100.0, 50.0, 0.0, 10.0), exp(-0.0025 / 0.02), 0.0)
    assert speeds[0] == pytest.approx(100 * (1 - exp(-1)))


def test_ground_holds_levels_and_lets_go() -> None:
    x, body = State(1, 2, 0.3, 4, 0, 2, *quaternion_from_euler(0.4, -0.2, 1.0), 1, 1, 1), Body.of(NO_DRAG)
    for _ in range(400):
        x = rest_on_ground(step_free(x, Wrench(0, 0, 0, 0), CALM, body, 0.0025), 0.0025)
    assert x.position_ned_m == pytest.approx((2.0, 2, 0), abs=0.1)  # v^2 / (2 mu g) further on
    assert x.velocity_ned_mps == (0, 0, 0)
    assert (x.p, x.q, x.r) == pytest.approx((0, 0, 0), abs=1e-3)
    assert euler_from_quaternion(x.q_wb_wxyz) == pytest.approx((0, 0, 1.0), abs=0.1)
    rising = x._replace(vd=-1.0)
    assert rest_on_ground(rising, 0.0025).vd == -1.0
    assert rest_on_ground(airborne(), 0.0025) is not None


def test_what_turns_on_the_ground_turns_by_its_rates() -> None:
    """A gyroscope feels how the feet level the body and hold it against the rotors: dead reckoned, it has the attitude."""
    x, body = state_at_rest(0.3)._replace(q=0.5), Body.of(NO_DRAG)
    believed, largest = x.q_wb_wxyz, 0.0
    for k in range(400):
        wrench = Wrench(5.0, 0.4 if k < 200 else -0.3, 0.2, 0.05)
        after = rest_on_ground(step_free(x, wrench, CALM, body, 0.0025), 0.0025)
        believed = turned(believed, (after.p * 0.0025, after.q * 0.0025, after.r * 0.0025))
        x = after
        assert abs(np.dot(believed, x.q_wb_wxyz)) > cos(radians(0.15) / 2.0)
        largest = max(largest, abs(euler_from_quaternion(x.q_wb_wxyz).roll_rad))
    assert largest > radians(2.0)


def test_accelerometer_feels_one_g_up_on_the_ground_and_nothing_in_free_fall() -> None:
    x = state_at_rest(0.3)
    assert specific_force(x, x, 0.0025) == pytest.approx((0, 0, -GRAVITY_MPS2))
    falling = step_free(airborne(), Wrench(0, 0, 0, 0), CALM, Body.of(NO_DRAG), 0.0025)
    assert specific_force(airborne(), falling, 0.0025) == pytest.approx((0, 0, 0), abs=1e-9)


@given(roll=angle, pitch=steep, yaw=angle, x=number, y=number, z=number)
def test_rotations_round_trip(roll: float, pitch: float, yaw: float, x: float, y: float, z: float) -> None:
    q = quaternion_from_euler(roll, pitch, yaw)
    assert rotate_back(q, rotate(q, (x, y, z))) == pytest.approx((x, y, z), abs=1e-9)
    assert euler_from_quaternion(q) == pytest.approx((roll, pitch, yaw), abs=1e-6)
    axes = [rotate(q, tuple(float(i == k) for i in range(3))) for k in range(3)]
    again = quaternion_from_axes(*axes)
    assert abs(sum(a * b for a, b in zip(q, again, strict=True))) == pytest.approx(1.0, abs=1e-9)


@given(roll=angle, pitch=steep, yaw=angle)
def test_enu_attitude_agrees_with_swapped_vectors(roll: float, pitch: float, yaw: float) -> None:
    q = quaternion_from_euler(roll, pitch, yaw)
    turned = enu_flu_from_ned_frd(q)
    for forward, left, up in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
        n, e, d = rotate(q, (forward, -left, -up))
        assert rotate(turned, (forward, left, up)) == pytest.approx((e, n, -d), abs=1e-9)


def test_facing_north_is_a_quarter_turn_in_enu_and_east_is_none() -> None:
    w, x, y, z = enu_flu_from_ned_frd(quaternion_from_euler(0, 0, 0))
    assert (abs(w), x, y, z * (1 if w > 0 else -1)) == pytest.approx((cos(pi / 4), 0, 0, cos(pi / 4)), abs=1e-12)
    east = enu_flu_from_ned_frd(quaternion_from_euler(0, 0, radians(90)))
    assert abs(east[0]) == pytest.approx(1.0)
    assert yaw_of(
        quaternion_multiply(quaternion_from_euler(0, 0, 0.5), quaternion_from_euler(0, 0, 0.25))
    ) == pytest.approx(0.75)


def test_wind_turns_enu_into_ned_and_gusts_keep_their_spread() -> None:
    model = WindModel.of(
        WindConfig(mean_enu_mps=(1.0, 2.0, 3.0), gust_std_mps=(0.5, 1.0, 0.0), gust_correlation_s=0.5), 0.01
    )
    assert model.mean_ned_mps == (2.0, 1.0, -3.0)
    gust, seen = (0.0, 0.0, 0.0), []
    for normal in NoiseTable(4, (("wind", 3),), 100_000).values.tolist():
        gust = next_value(gust, model.keep, model.kick_ned_mps, tuple(normal))
        seen.append(gust)
    north, east, down = np.std(seen, axis=0)
    assert (north, east) == pytest.approx((1.0, 0.5), rel=0.08)
    assert down == 0.0
    series = np.array(seen)[:, 0]
    assert np.corrcoef(series[:-50], series[50:])[0, 1] == pytest.approx(exp(-1), abs=0.08)


def test_estimate_error_has_the_configured_spread() -> None:
    model = ErrorModel.of(SensorsConfig(estimate_correlation_s=0.2), 0.01)
    error, seen = EstimateError(CALM, CALM, CALM), []
    for row in NoiseTable(1, (("estimate", 9),), 40_000).values.tolist():
        error = next_error(error, model, tuple(row[:3]), tuple(row[3:6]), tuple(row[6:]))
        seen.append([*error.position_m, *error.velocity_mps])
    assert np.std(seen, axis=0) == pytest.approx([0.02] * 6, rel=0.1)


def test_streams_depend_on_seed_and_place_alone() -> None:
    table = NoiseTable(7, (("a", 1), ("b", 3)), 50)
    wider = NoiseTable(7, (("a", 2), ("b", 3)), 50)
    assert np.array_equal(table.values[:, 1:], wider.values[:, 2:])
    again, other = NoiseTable(7, (("a", 1), ("b", 3)), 50), NoiseTable(8, (("a", 1), ("b", 3)), 50)
    assert np.array_equal(table.values, again.values)
    assert not np.array_equal(table.values, other.values)
    table.refill()
    assert not np.array_equal(table.values, again.values)
    long = NoiseTable(7, (("a", 1), ("b", 1)), 4000).values
    assert abs(np.corrcoef(long[:, 0], long[:, 1])[0, 1]) < 0.06


def test_battery_sags_empties_and_slows_the_rotors() -> None:
    config, rotors = BatteryConfig(), RotorModel.of(AirframeConfig())
    hover = (rotors.max_speed_radps * 0.77,) * 4
    state = fresh_battery(config)
    idle = step_battery(state, (0, 0, 0, 0), rotors, Pack.of(config), 0.01)
    loaded = step_battery(state, hover, rotors, Pack.of(config), 0.01)
    assert loaded.voltage_v < idle.voltage_v < config.cells * 4.2
    assert 5.0 < loaded.current_a < 40.0
    charges = []
    for _ in range(400):
        state = step_battery(state, hover, rotors, Pack.of(config), 10.0)
        charges.append(state.charge)
    assert charges == sorted(charges, reverse=True)
    assert state.charge == 0.0
    assert 0.5 < top_speed_fraction(state.voltage_v, config.cells) < 1.0
    assert state.consumed_ah > config.capacity_ah
    assert [open_circuit_cell_v(c) for c in (0.0, 0.5, 1.0)] == pytest.approx([3.0, 3.78, 4.18])


def test_battery_conserves_charge() -> None:
    config, rotors = BatteryConfig(), RotorModel.of(AirframeConfig())
    state, drawn_as = fresh_battery(config), 0.0
    for _ in range(1000):
        state = step_battery(state, (500.0,) * 4, rotors, Pack.of(config), 0.1)
        drawn_as += state.current_a * 0.1
    assert (1.0 - state.charge) * config.capacity_ah == pytest.approx(drawn_as / 3600.0)


@given(n=st.floats(-2000, 2000), e=st.floats(-2000, 2000), d=st.floats(-500, 100))
def test_geodetic_round_trip(n: float, e: float, d: float) -> None:
    frame = GeoFrame.at(HomeConfig())
    assert frame.to_ned(frame.to_geodetic((n, e, d))) == pytest.approx((n, e, d), abs=1e-5)


def test_a_hundred_metres_north_and_east_by_an_independent_library() -> None:
    pymap3d = pytest.importorskip("pymap3d")
    home = HomeConfig()
    place = GeoFrame.at(home).to_geodetic((100.0, 200.0, -5.0))
    expected = pymap3d.ned2geodetic(100.0, 200.0, -5.0, home.latitude_deg, home.longitude_deg, home.altitude_m)
    assert isinstance(place, Geodetic)
    assert place[:2] == pytest.approx(expected[:2], abs=6e-8)
    assert place[2] == pytest.approx(expected[2], abs=0.01)


def test_pressure_of_the_standard_atmosphere() -> None:
    assert pressure_hpa(0.0) == 1013.25
    assert pressure_hpa(1000.0) == pytest.approx(898.7, abs=0.3)
    assert pressure_altitude_m(pressure_hpa(488.0)) == pytest.approx(488.0)
