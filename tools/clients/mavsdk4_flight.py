"""A MAVSDK-Python 4 program: every feature is a step; prints one JSON line a step. Run by an interpreter that has mavsdk 4.

python mavsdk4_flight.py URL        such as udpin://127.0.0.1:14540
"""

import json
import math
import sys
import time
from collections.abc import Callable
from importlib import import_module
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk

#: Telemetry of parts that PX4's built-in simulator has not (distance sensor, servos' feedback, wind sensor) or that it does not send.
NOT_SENT = {"actuator_control_target", "actuator_output_status", "distance_sensor", "raw_imu", "scaled_imu", "wind"}
#: Messages that PX4 does not know at all.
NO_RATE = {"actuator_control_target", "raw_imu"}


def part(system: Any, name: str) -> Any:
    module = import_module(f"mavsdk.plugins.{name}")
    cls = "".join(word.capitalize() for word in name.split("_"))
    return getattr(module, cls)(system)


def until(condition: Callable[[], bool], limit_s: float, what: str) -> None:
    end = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(f"waited {limit_s} s for: {what}")
        time.sleep(0.02)


def near(a: float, b: float, tolerance: float, what: str) -> None:
    if not abs(a - b) <= tolerance:
        raise AssertionError(f"{what}: {a:.3f}, expected {b:.3f} +- {tolerance}")


def refused(call: Callable[[], Any], within_s: float) -> str:
    begin = time.monotonic()
    try:
        answer = call()
    except Exception as error:
        if time.monotonic() - begin > within_s:
            raise AssertionError(f"refused, but only after {time.monotonic() - begin:.1f} s") from error
        return str(error)[:90]
    raise AssertionError(f"not refused: {answer}")


class Flight:
    def __init__(self, url: str) -> None:
        self.mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
        self.mavsdk.add_any_connection(url)
        system = self.mavsdk.first_autopilot(10.0)
        if system is None:
            raise TimeoutError("no vehicle was discovered")
        self.system = system
        self.telemetry, self.action, self.offboard = (part(system, n) for n in ("telemetry", "action", "offboard"))
        self.mission, self.param, self.geofence = (part(system, n) for n in ("mission", "param", "geofence"))

    def position(self) -> tuple[float, float, float]:
        p = self.telemetry.position_velocity_ned().position
        return p.north_m, p.east_m, p.down_m

    def velocity(self) -> tuple[float, float, float]:
        v = self.telemetry.velocity_ned()
        return v.north_m_s, v.east_m_s, v.down_m_s

    def mode(self) -> str:
        return str(self.telemetry.flight_mode().name)

    def health(self) -> None:
        until(self.telemetry.health_all_ok, 10, "health_all_ok")
        until(lambda: self.telemetry.health().is_armable, 10, "is_armable")

    def every_stream(self) -> str:
        """Each subscription is called; those of parts that PX4's simulator has not are left out."""
        names = {name.removeprefix("subscribe_") for name in dir(self.telemetry) if name.startswith("subscribe_")}
        names -= NOT_SENT
        heard: set[str] = set()
        for name in names:
            subscribe = getattr(self.telemetry, f"subscribe_{name}")
            if name == "status_text":
                subscribe(lambda _text, _data: None)
                heard.add(name)
            else:
                subscribe(lambda _value, _data, n=name: heard.add(n))
        self.telemetry.set_rate_ground_truth(5.0)
        try:
            until(lambda: names <= heard, 8, "every stream")
        except TimeoutError as error:
            raise TimeoutError(f"nothing came of {sorted(names - heard)}") from error
        near(self.telemetry.position().latitude_deg, 47.397742, 1e-4, "latitude")
        near(self.telemetry.attitude_euler().yaw_deg, 0.0, 5.0, "yaw")
        return f"{len(names)} streams"

    def parameters(self) -> None:
        near(self.param.get_param_float("COM_OF_LOSS_T"), 1.0, 1e-6, "COM_OF_LOSS_T")
        self.param.set_param_float("MPC_XY_CRUISE", 6.5)
        near(self.param.get_param_float("MPC_XY_CRUISE"), 6.5, 1e-6, "MPC_XY_CRUISE")
        self.param.set_param_int("GF_ACTION", 3)
        near(self.param.get_param_int("GF_ACTION"), 3, 0, "GF_ACTION")
        everything = self.param.get_all_params()
        assert len(everything.float_params) > 60, len(everything.float_params)
        assert len(everything.int_params) > 15, len(everything.int_params)

    def parameter_of_wrong_type(self) -> str:
        return refused(lambda: self.param.set_param_int("MPC_XY_CRUISE", 6), 5.0)

    def parameter_unknown(self) -> str:
        return refused(lambda: self.param.get_param_int("NO_SUCH"), 8.0)

    def set_rates(self) -> str:
        """All of them; and a rate that is asked for is the rate that comes."""
        names = [name for name in dir(self.telemetry) if name.startswith("set_rate_") and not name.endswith("_async")]
        for name in names:
            if name.removeprefix("set_rate_") in NO_RATE:
                refused(lambda n=name: getattr(self.telemetry, n)(5.0), 5.0)
            else:
                getattr(self.telemetry, name)(5.0)
        return f"{len(names)} rates"

    def info(self) -> None:
        info = part(self.system, "info")
        until(lambda: info.get_version().flight_sw_major == 1, 5, "version")

    def takeoff_altitude(self) -> None:
        self.action.set_takeoff_altitude(4.0)
        near(self.action.get_takeoff_altitude(), 4.0, 0.01, "take-off altitude")

    def arm_and_takeoff(self) -> None:
        self.action.arm()
        until(self.telemetry.armed, 5, "armed")
        self.action.takeoff()
        until(self.telemetry.in_air, 10, "in air")
        until(lambda: self.mode() == "HOLD", 20, "Hold after take-off")
        near(-self.position()[2], 4.0, 0.4, "height")

    def goto(self) -> None:
        p = self.telemetry.position()
        self.action.goto_location(p.latitude_deg + 8 / 111190, p.longitude_deg, p.absolute_altitude_m + 1.0, 90.0)
        until(lambda: abs(self.position()[0] - 8) < 0.5 and abs(self.position()[2] + 5) < 0.5, 20, "8 m north, 1 m up")
        until(lambda: abs(self.telemetry.heading().heading_deg - 90) < 5, 10, "facing east")

    def speed(self) -> None:
        self.action.set_current_speed(3.0)

    def hold(self) -> None:
        self.action.hold()
        until(lambda: self.mode() == "HOLD", 5, "Hold")

    def set_points(self) -> None:
        from mavsdk.plugins.offboard.offboard import (
            AccelerationNed,
            Attitude,
            AttitudeRate,
            PositionNedYaw,
            VelocityBodyYawspeed,
            VelocityNedYaw,
        )  # fmt: skip

        o, still = self.offboard, VelocityNedYaw(0.0, 0.0, 0.0, 0.0)
        o.set_position_ned(PositionNedYaw(0.0, 0.0, -5.0, 0.0))
        o.start()
        until(lambda: self.mode() == "OFFBOARD", 5, "Offboard")
        until(lambda: math.dist(self.position(), (0, 0, -5)) < 0.5, 20, "set_position_ned")
        o.set_position_velocity_ned(PositionNedYaw(3.0, 2.0, -5.0, 0.0), still)
        until(lambda: math.dist(self.position(), (3, 2, -5)) < 0.5, 20, "set_position_velocity_ned")
        o.set_position_velocity_acceleration_ned(
            PositionNedYaw(0.0, 2.0, -5.0, 0.0), still, AccelerationNed(0.0, 0.0, 0.0)
        )
        until(lambda: math.dist(self.position(), (0, 2, -5)) < 0.5, 20, "set_position_velocity_acceleration_ned")
        o.set_velocity_ned(VelocityNedYaw(0.0, 1.5, 0.0, 0.0))
        until(lambda: abs(self.velocity()[1] - 1.5) < 0.3, 10, "set_velocity_ned east")
        o.set_velocity_ned(VelocityNedYaw(0.0, 0.0, 0.0, 90.0))
        until(lambda: abs(self.telemetry.heading().heading_deg - 90) < 5, 15, "turn to east")
        o.set_velocity_body(VelocityBodyYawspeed(1.5, 0.0, 0.0, 0.0))
        until(lambda: abs(self.velocity()[1] - 1.5) < 0.3 and abs(self.velocity()[0]) < 0.4, 10, "set_velocity_body")
        o.set_velocity_body(VelocityBodyYawspeed(0.0, 0.0, 0.0, 0.0))
        until(lambda: math.hypot(*self.velocity()) < 0.3, 10, "stop")
        o.set_acceleration_ned(AccelerationNed(1.0, 0.0, 0.0))
        until(lambda: self.velocity()[0] > 1.0, 10, "set_acceleration_ned")
        o.set_velocity_ned(VelocityNedYaw(0.0, 0.0, -0.5, 90.0))
        until(lambda: math.hypot(*self.velocity()[:2]) < 0.3, 10, "stop")
        until(lambda: self.position()[2] < -8.0, 30, "climb")
        hover = self.param.get_param_float("MPC_THR_HOVER")
        o.set_attitude(Attitude(0.0, -10.0, 90.0, hover * 1.02))
        until(lambda: self.velocity()[1] > 1.0, 10, "set_attitude: nose down facing east flies east")
        o.set_attitude_rate(AttitudeRate(0.0, 0.0, 30.0, hover * 1.02))
        time.sleep(0.1)
        o.set_position_ned(PositionNedYaw(0.0, 0.0, -6.0, 0.0))
        until(lambda: math.dist(self.position(), (0, 0, -6)) < 0.6, 30, "back")
        o.stop()
        until(lambda: self.mode() == "HOLD", 5, "Hold after offboard.stop")

    def mission_items(self) -> None:
        from mavsdk.plugins.mission.mission import MissionItem, MissionPlan

        lat, lon = 47.397742, 8.545594
        places = [(10, 0), (10, 10), (0, 10)]
        items = [
            MissionItem(lat + n / 111190, lon + e / 75400, 6.0, 5.0, True, acceptance_radius_m=1.0) for n, e in places
        ]
        self.mission.upload_mission(MissionPlan(items))
        down = self.mission.download_mission()
        assert len(down.mission_items) == 3, down
        near(down.mission_items[1].latitude_deg, items[1].latitude_deg, 1e-6, "second item's latitude")

    def mission_flown(self) -> None:
        self.mission.start_mission()
        until(lambda: self.mode() == "MISSION", 5, "Mission")
        until(lambda: self.mission.mission_progress().current >= 1, 20, "first item reached")
        self.mission.pause_mission()
        until(lambda: self.mode() == "HOLD", 5, "paused")
        self.mission.start_mission()
        until(self.mission.is_mission_finished, 40, "finished")
        near(self.position()[1], 10.0, 2.5, "east of the last place")

    def mission_cleared(self) -> None:
        self.mission.clear_mission()
        assert not self.mission.download_mission().mission_items

    def fence(self) -> None:
        from mavsdk.plugins.geofence.geofence import FenceType, GeofenceData, Point, Polygon

        lat, lon = 47.397742, 8.545594
        corners = [Point(lat + n, lon + e) for n, e in ((-1e-3, -1e-3), (1e-3, -1e-3), (1e-3, 1e-3), (-1e-3, 1e-3))]
        self.geofence.upload_geofence(GeofenceData([Polygon(corners, FenceType.INCLUSION)], []))
        self.geofence.clear_geofence()

    def refuses_ftp(self) -> str:
        return refused(lambda: part(self.system, "ftp").list_directory("/"), 6.0)

    def refuses_calibration(self) -> str:
        calibration, results = part(self.system, "calibration"), []
        for kind in ("gyro", "accelerometer", "magnetometer", "level_horizon"):
            results.clear()
            getattr(calibration, f"calibrate_{kind}_async")(lambda result, _data, _user: results.append(result))
            until(lambda: bool(results), 8, f"an answer to calibrate_{kind}")
            assert results[-1].name == "UNSUPPORTED", f"calibrate_{kind}: {results}"
        return str(results[-1].name)

    def refuses_camera(self) -> str:
        camera = part(self.system, "camera")
        assert not camera.camera_list().cameras
        return refused(lambda: camera.take_photo(1), 5.0)

    def refuses_gimbal(self) -> str:
        from mavsdk.plugins.gimbal.gimbal import GimbalMode, SendMode

        gimbal = part(self.system, "gimbal")
        assert not gimbal.gimbal_list().gimbals
        return refused(lambda: gimbal.set_angles(1, 0.0, 0.0, 0.0, GimbalMode.YAW_FOLLOW, SendMode.ONCE), 5.0)

    def injects_failure(self) -> str:
        """Refused while SYS_FAILURE_EN is 0, as PX4 does."""
        from mavsdk.plugins.failure.failure import FailureType, FailureUnit

        return refused(lambda: part(self.system, "failure").inject(FailureUnit.SENSOR_GPS, FailureType.OFF, 0), 5.0)

    def returns(self) -> None:
        self.param.set_param_float("RTL_RETURN_ALT", 8.0)
        self.action.return_to_launch()
        until(lambda: self.mode() == "RETURN_TO_LAUNCH", 5, "Return")
        until(lambda: not self.telemetry.armed(), 60, "landed and disarmed")
        near(math.hypot(*self.position()[:2]), 0.0, 1.0, "distance from home")

    def lands(self) -> None:
        self.action.arm()
        self.action.takeoff()
        until(lambda: self.mode() == "HOLD" and self.telemetry.in_air(), 25, "in the air again")
        self.action.land()
        until(lambda: self.telemetry.landed_state().name in ("LANDING", "ON_GROUND"), 5, "landing state")
        until(lambda: not self.telemetry.in_air(), 30, "on the ground")
        until(lambda: not self.telemetry.armed(), 15, "disarmed")


STEPS = (
    "health", "every_stream", "info", "parameters", "parameter_of_wrong_type", "parameter_unknown", "set_rates",
    "refuses_calibration", "takeoff_altitude", "arm_and_takeoff", "goto", "speed", "hold", "set_points", "mission_items", "mission_flown",
    "mission_cleared", "fence", "refuses_ftp", "refuses_camera", "refuses_gimbal",
    "injects_failure", "returns", "lands",
)  # fmt: skip


def main() -> None:
    flight = Flight(sys.argv[1])
    print(json.dumps({"step": "connect", "ok": True, "note": ""}), flush=True)
    for name in sys.argv[2:] or STEPS:
        begin = time.monotonic()
        try:
            note, ok = getattr(flight, name)() or "", True
        except Exception as error:  # noqa: BLE001
            note, ok = f"{type(error).__name__}: {error}", False
        print(json.dumps({"step": name, "ok": ok, "note": note, "s": round(time.monotonic() - begin, 2)}), flush=True)
    flight.mavsdk.destroy()


main()
