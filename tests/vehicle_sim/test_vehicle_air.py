"""Turbulence against MIL-F-8785C, gusts, the x500 airframe, laws of energy and gyroscopic torque, failures."""

from math import cos, pi, sin, sqrt
from pathlib import Path

import numpy as np
import pytest
from scipy import integrate, signal

from vehicle_sim.config import load_run, parse_vehicle_section
from vehicle_sim.dynamics import GRAVITY_MPS2, Body, State, state_at_rest, state_derivative, step_free
from vehicle_sim.errors import ConfigError
from vehicle_sim.parts import AirframeConfig, FailureConfig, GustConfig, WindConfig
from vehicle_sim.rotation import rotate
from vehicle_sim.rotors import RotorModel, Wrench, rotor_wrench
from vehicle_sim.wind import Pair, discrete_gust, gust_of, next_pair, next_u, turbulence_at

from .flight import STILL, Flight
from .node_client import EXACT

CONFIGS = Path(__file__).parents[2] / "configs"
FEET = 0.3048


def x500() -> AirframeConfig:
    return parse_vehicle_section({"airframe": "vehicles/x500.yaml"}, str(CONFIGS / "single.yaml")).airframe


def test_dryden_scales_by_hand() -> None:
    t = turbulence_at(100 * FEET, 10.0)
    base = 0.177 + 0.000823 * 100
    assert t.sigma_w_mps == pytest.approx(1.0)
    assert t.length_w_m == pytest.approx(100 * FEET)
    assert t.length_uv_m == pytest.approx(100 * FEET / base**1.2)
    assert t.sigma_uv_mps == pytest.approx(1.0 / base**0.4)
    assert turbulence_at(1000 * FEET, 10.0).length_uv_m == pytest.approx(1000 * FEET, rel=2e-3)  # isotropic at 1000 ft
    assert turbulence_at(0.0, 10.0) == turbulence_at(10 * FEET, 10.0)


def psd_u(f_hz: np.ndarray, length_m: float, sigma: float, airspeed: float) -> np.ndarray:
    """MIL-F-8785C, one-sided in Hz."""
    w = 2 * pi * f_hz
    return 2 * pi * sigma**2 * 2 * length_m / (pi * airspeed) / (1 + (length_m * w / airspeed) ** 2)


def psd_w(f_hz: np.ndarray, length_m: float, sigma: float, airspeed: float) -> np.ndarray:
    a = (length_m * 2 * pi * f_hz / airspeed) ** 2
    return 2 * pi * sigma**2 * length_m / (pi * airspeed) * (1 + 3 * a) / (1 + a) ** 2


def test_dryden_formulae_integrate_to_the_variance() -> None:
    for psd in (psd_u, psd_w):
        total = integrate.quad(lambda f, g=psd: float(g(np.array(f), 30.0, 1.5, 8.0)), 0, np.inf)[0]
        assert total == pytest.approx(1.5**2, rel=1e-6)


@pytest.mark.parametrize("dt_s", [0.01, 0.05])
def test_dryden_spectra_match_the_formula(dt_s: float) -> None:
    length, sigma, airspeed, count = 20.0, 1.3, 10.0, 200_000
    normal = np.random.default_rng(3).standard_normal((count, 3)).tolist()
    u, pair, along, across = 0.0, Pair(0.0, 0.0), np.zeros(count), np.zeros(count)
    for k, (a, b, c) in enumerate(normal):
        u = next_u(u, length / airspeed, sigma, dt_s, a)
        pair = next_pair(pair, length / airspeed, sigma, dt_s, b, c)
        along[k], across[k] = u, gust_of(pair)
    assert np.std(along) == pytest.approx(sigma, rel=0.06)
    assert np.std(across) == pytest.approx(sigma, rel=0.06)
    for series, psd in ((along, psd_u), (across, psd_w)):
        f, measured = signal.welch(series, 1 / dt_s, nperseg=4096)
        chosen = (f > 0.03) & (f < 2.0)
        ratio = measured[chosen] / psd(f[chosen], length, sigma, airspeed)
        assert np.mean(ratio) == pytest.approx(1.0, abs=0.1)
        for low, high in ((0.03, 0.1), (0.1, 0.5), (0.5, 2.0)):
            band = ratio[(f[chosen] >= low) & (f[chosen] < high)]
            assert np.mean(band) == pytest.approx(1.0, abs=0.2), (low, high)


def test_turbulence_shakes_the_vehicle_and_none_does_not() -> None:
    calm, rough = (Flight(wind=WindConfig(mean_enu_mps=(5.0, 0.0, 0.0), dryden_w20_mps=w)) for w in (0.0, 10.0))
    winds: dict[int, list[tuple[float, float, float]]] = {0: [], 1: []}
    for k, flight in enumerate((calm, rough)):
        flight.take_off()
        flight.run(20.0, each=lambda f=flight, k=k: winds[k].append(f.vehicle.wind_ned_mps))
    assert np.std(winds[0], axis=0) == pytest.approx([0, 0, 0], abs=1e-12)
    spread = np.std(winds[1], axis=0)
    assert 0.4 < spread[0] < 3.0
    assert 0.4 < spread[1] < 3.0
    assert np.mean(winds[1], axis=0)[1] == pytest.approx(5.0, abs=1.5)


def test_a_discrete_gust_by_hand_and_in_flight() -> None:
    gust = GustConfig(at_s=13.0, duration_s=2.0, peak_enu_mps=(6.0, 0.0, 1.0))
    assert discrete_gust((gust,), 14.0) == pytest.approx((0.0, 6.0, -1.0))
    assert discrete_gust((gust,), 13.5) == pytest.approx((0.0, 3.0, -0.5))
    assert discrete_gust((gust,), 12.9) == discrete_gust((gust,), 15.1) == (0.0, 0.0, 0.0)
    flight = Flight(wind=WindConfig(discrete_gusts=(gust,)), sensors=EXACT).take_off()
    pushed: list[float] = []
    flight.run(6.0, each=lambda: pushed.append(flight.vehicle.state.e))
    assert 0.05 < max(pushed) < 1.0
    assert abs(pushed[-1]) < 0.2


def test_the_x500_file_hovers_where_its_thrust_says() -> None:
    airframe = x500()
    assert airframe.mass_kg == 2.064
    flight = Flight(airframe=airframe, sensors=EXACT).take_off()
    flight.run(4.0)
    expected = sqrt(airframe.mass_kg * GRAVITY_MPS2 / 4 / airframe.thrust_coefficient_n_per_radps2)
    assert np.mean(flight.vehicle.speeds_radps) == pytest.approx(expected, rel=0.01)
    assert expected == pytest.approx(769.0, abs=1.0)  # rad/s, by hand
    overshoot: list[float] = []
    flight.run(8.0, (2.0, 0.0, -3.0), lambda: overshoot.append(flight.vehicle.state.n))
    assert max(overshoot) < 2.3
    assert overshoot[-1] == pytest.approx(2.0, abs=0.05)


def test_an_airframe_file_is_checked(tmp_path: Path) -> None:
    run = tmp_path / "run.yaml"
    run.write_text("start_m: [0.0, 0.0]\nvehicle: {airframe: mine.yaml}\n")
    with pytest.raises(ConfigError, match=r"mine.yaml: cannot be read"):
        load_run(run)
    (tmp_path / "mine.yaml").write_text("mass: 3.0\n")
    with pytest.raises(ConfigError, match=r"mine.yaml:1: mass: is not a known key"):
        load_run(run)
    (tmp_path / "mine.yaml").write_text("mass_kg: 3.0\n")
    assert load_run(run).vehicle.airframe.mass_kg == 3.0


def test_rotor_drag_grows_with_rotor_speed() -> None:
    airframe = AirframeConfig(
        linear_drag_n_per_mps=(0.0, 0.0, 0.0), quadratic_drag_n_per_mps2=0.0, rotor_drag_n_per_mps_radps=8e-5
    )
    flight = Flight(airframe=airframe, wind=WindConfig(mean_enu_mps=(4.0, 0.0, 0.0))).take_off()
    flight.run(8.0)
    drag = 8e-5 * sum(flight.vehicle.speeds_radps) * 4.0
    tilt = np.degrees(2 * abs(flight.vehicle.state.qx))
    assert tilt == pytest.approx(np.degrees(np.arctan(drag / (airframe.mass_kg * GRAVITY_MPS2))), rel=0.15)


def test_gyroscopic_torque_does_no_work() -> None:
    body = Body.of(AirframeConfig(inertia_kgm2=(0.02, 0.03, 0.045)))
    rng = np.random.default_rng(1)
    for p, q, r in rng.uniform(-10, 10, (50, 3)):
        x = State(0, 0, -10, 0, 0, 0, 1, 0, 0, 0, p, q, r)
        x_dot = state_derivative(x, Wrench(0, 0, 0, 0), STILL, body)
        power = sum(
            J * w * a for J, w, a in zip(body.inertia_kgm2, (p, q, r), (x_dot.p, x_dot.q, x_dot.r), strict=True)
        )
        assert power == pytest.approx(0.0, abs=1e-12)


def test_axisymmetric_body_precesses_as_euler_says() -> None:
    body = Body.of(AirframeConfig(inertia_kgm2=(0.02, 0.02, 0.04)))
    x, spin, dt = state_at_rest(0.0)._replace(d=-100.0, p=1.0, r=5.0), 5.0, 0.0005
    rate = (0.04 - 0.02) / 0.02 * spin
    for _ in range(round(0.7 / dt)):
        x = step_free(x, Wrench(0, 0, 0, 0), STILL, body, dt)
    assert (x.p, x.q) == pytest.approx((cos(rate * 0.7), sin(rate * 0.7)), abs=1e-4)
    assert x.r == spin


def test_energy_balance_of_a_climb() -> None:
    """Work of the thrust is what kinetic and potential energy gain and drag takes."""
    airframe = AirframeConfig()
    body, dt = Body.of(airframe), 0.0005
    x = state_at_rest(0.0)._replace(d=-50.0, vn=4.0, q=0.3)
    wrench = Wrench(1.2 * body.mass_kg * GRAVITY_MPS2, 0.0, 0.0, 0.0)
    balance, energy = (
        0.0,
        lambda s: 0.5 * body.mass_kg * (s.vn**2 + s.ve**2 + s.vd**2) - body.mass_kg * GRAVITY_MPS2 * s.d,
    )
    start = energy(x)
    for _ in range(2000):
        n, e, d = rotate(x.q_wb_wxyz, (0.0, 0.0, -wrench.thrust_n))
        coasting = state_derivative(x, Wrench(0, 0, 0, 0), STILL, body)
        drag_w = body.mass_kg * (x.vn * coasting.vn + x.ve * coasting.ve + x.vd * (coasting.vd - GRAVITY_MPS2))
        balance += (n * x.vn + e * x.ve + d * x.vd + drag_w) * dt
        x = step_free(x, wrench, STILL, body, dt)
    assert energy(x) - start == pytest.approx(balance, rel=2e-3)


def test_wrench_of_one_stopped_rotor_rolls_towards_it() -> None:
    rotors = RotorModel.of(x500())
    wrench = rotor_wrench((0.0, 700.0, 700.0, 700.0), rotors)  # front right stands
    assert wrench.roll_nm > 0 > wrench.pitch_nm
    assert wrench.thrust_n == pytest.approx(3 * 8.54858e-06 * 700**2)


@pytest.mark.parametrize("part", ["motor", "battery"])
def test_losing_a_motor_or_the_battery_brings_the_vehicle_down(part: str) -> None:
    failure = FailureConfig(at_s=14.0, part=part, instance=1 if part == "motor" else 0)  # type: ignore[arg-type]
    flight = Flight(failures=(failure,)).take_off()
    flight.run(2.0)
    assert flight.vehicle.state.d < -2.5
    flight.run(20.0)
    if part == "motor":
        assert flight.vehicle.speeds_radps[0] < 1.0
        assert flight.vehicle.state.d > -0.5
    else:
        assert flight.vehicle.battery.charge == 0.0


def test_a_wind_step_is_fought() -> None:
    step = FailureConfig(at_s=13.0, part="wind", wind_enu_mps=(0.0, 6.0, 0.0))
    flight = Flight(failures=(step,), sensors=EXACT).take_off()
    drift: list[float] = []
    flight.run(12.0, each=lambda: drift.append(flight.vehicle.state.n))
    assert flight.vehicle.wind_ned_mps[0] == 6.0
    assert 0.05 < max(drift) < 1.5
    assert abs(drift[-1]) < 0.15
