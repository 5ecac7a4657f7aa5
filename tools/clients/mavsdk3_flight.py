"""A MAVSDK-Python 3 program (gRPC, its own server): every feature is a step; prints one JSON line a step.

python mavsdk3_flight.py URL        such as udpin://127.0.0.1:14540
"""

import asyncio
import json
import math
import os
import socket
import sys
import time
from collections.abc import AsyncIterator, Callable
from typing import Any

from mavsdk import System
from mavsdk.action import ActionError
from mavsdk.calibration import CalibrationError
from mavsdk.camera import CameraError
from mavsdk.ftp import FtpError
from mavsdk.geofence import FenceType, GeofenceData, Point, Polygon
from mavsdk.gimbal import GimbalError, GimbalMode, SendMode
from mavsdk.mission import MissionItem, MissionPlan
from mavsdk.offboard import (
    AccelerationNed,
    Attitude,
    OffboardError,
    PositionNedYaw,
    VelocityBodyYawspeed,
    VelocityNedYaw,
)  # fmt: skip
from mavsdk.param import ParamError
from mavsdk.telemetry import FlightMode, TelemetryError

#: Telemetry of parts that PX4's built-in simulator has not or that it does not send, and texts, which come when there is something to say.
NOT_SENT = {
    "actuator_control_target", "actuator_output_status", "distance_sensor", "raw_imu", "scaled_imu", "wind", "status_text",
    "name",
}  # fmt: skip
#: Messages that PX4 does not know at all.
NO_RATE = {"actuator_control_target", "raw_imu"}


async def first(stream: AsyncIterator[Any], limit_s: float = 5.0) -> Any:
    return await asyncio.wait_for(anext(stream), limit_s)


async def until(stream: AsyncIterator[Any], condition: Callable[[Any], bool], limit_s: float, what: str) -> None:
    async def wait() -> None:
        async for value in stream:
            if condition(value):
                return

    try:
        await asyncio.wait_for(wait(), limit_s)
    except TimeoutError as error:
        raise TimeoutError(f"waited {limit_s} s for: {what}") from error


class Flight:
    def __init__(self, drone: System) -> None:
        self.drone, self.telemetry, self.action = drone, drone.telemetry, drone.action

    async def at(self, place: tuple[float, float, float], limit_s: float, what: str, tolerance_m: float = 0.6) -> None:
        def there(state: Any) -> bool:
            p = state.position
            return math.dist((p.north_m, p.east_m, p.down_m), place) < tolerance_m

        await until(self.telemetry.position_velocity_ned(), there, limit_s, what)

    async def mode(self, mode: FlightMode, limit_s: float = 8.0) -> None:
        await until(self.telemetry.flight_mode(), lambda now: now == mode, limit_s, str(mode))

    async def health(self) -> None:
        await until(self.telemetry.health_all_ok(), bool, 10, "health_all_ok")
        await until(self.telemetry.health(), lambda h: h.is_armable, 10, "is_armable")

    async def every_stream(self) -> str:
        """A value comes of each; those of parts that PX4's simulator has not are left out."""
        await self.telemetry.set_rate_ground_truth(5.0)
        names = [n for n in dir(self.telemetry) if not n.startswith(("_", "set_rate", "get_")) and n not in NOT_SENT]
        for name in names:
            try:
                await first(getattr(self.telemetry, name)())
            except TimeoutError as error:
                raise TimeoutError(f"nothing came of {name}") from error
        return f"{len(names)} streams"

    async def info(self) -> None:
        assert (await self.drone.info.get_version()).flight_sw_major == 1

    async def parameters(self) -> None:
        assert await self.drone.param.get_param_float("COM_OF_LOSS_T") == 1.0
        await self.drone.param.set_param_float("MPC_XY_CRUISE", 6.5)
        assert await self.drone.param.get_param_float("MPC_XY_CRUISE") == 6.5
        await self.drone.param.set_param_int("GF_ACTION", 3)
        assert await self.drone.param.get_param_int("GF_ACTION") == 3
        everything = await self.drone.param.get_all_params()
        assert len(everything.float_params) > 60

    async def parameter_of_wrong_type(self) -> str:
        try:
            await self.drone.param.set_param_int("MPC_XY_CRUISE", 6)
        except ParamError as error:
            return str(error)[:80]
        raise AssertionError("not refused")

    async def set_rates(self) -> str:
        names = [name for name in dir(self.telemetry) if name.startswith("set_rate_")]
        for name in names:
            try:
                await getattr(self.telemetry, name)(5.0)
            except TelemetryError as error:
                if name.removeprefix("set_rate_") not in NO_RATE:
                    raise AssertionError(f"{name}: {error}") from error
        return f"{len(names)} rates"

    async def refuses_what_it_cannot(self) -> str:
        try:
            await self.drone.offboard.start()
        except OffboardError as error:
            return str(error)[:80]
        raise AssertionError("offboard without a set-point was not refused")

    async def arm_and_takeoff(self) -> None:
        await self.action.set_takeoff_altitude(4.0)
        assert abs(await self.action.get_takeoff_altitude() - 4.0) < 0.01
        await self.action.arm()
        await self.action.takeoff()
        await until(self.telemetry.in_air(), bool, 10, "in air")
        await self.mode(FlightMode.HOLD, 20)
        try:
            await self.action.disarm()
        except ActionError:
            return
        raise AssertionError("disarmed in the air")

    async def goto(self) -> None:
        p = await first(self.telemetry.position())
        await self.action.goto_location(p.latitude_deg + 8 / 111190, p.longitude_deg, p.absolute_altitude_m + 1.0, 0.0)
        await self.at((8.0, 0.0, -5.0), 20, "8 m north, 1 m up", 0.9)
        await self.action.set_current_speed(3.0)

    async def set_points(self) -> None:
        o, still = self.drone.offboard, VelocityNedYaw(0.0, 0.0, 0.0, 0.0)
        await o.set_position_ned(PositionNedYaw(0.0, 0.0, -5.0, 0.0))
        await o.start()
        await self.mode(FlightMode.OFFBOARD)
        await self.at((0.0, 0.0, -5.0), 20, "set_position_ned")
        await o.set_position_velocity_ned(PositionNedYaw(3.0, 2.0, -5.0, 0.0), still)
        await self.at((3.0, 2.0, -5.0), 20, "set_position_velocity_ned")
        zero = AccelerationNed(0.0, 0.0, 0.0)
        await o.set_position_velocity_acceleration_ned(PositionNedYaw(0.0, 2.0, -5.0, 0.0), still, zero)
        await self.at((0.0, 2.0, -5.0), 20, "set_position_velocity_acceleration_ned")
        velocity = self.telemetry.velocity_ned
        await o.set_velocity_ned(VelocityNedYaw(0.0, 1.5, 0.0, 0.0))
        await until(velocity(), lambda v: abs(v.east_m_s - 1.5) < 0.3, 10, "set_velocity_ned")
        await o.set_velocity_body(VelocityBodyYawspeed(1.5, 0.0, 0.0, 0.0))
        await until(velocity(), lambda v: abs(v.north_m_s - 1.5) < 0.3, 10, "set_velocity_body, facing north")
        await o.set_acceleration_ned(AccelerationNed(0.0, 1.0, 0.0))
        await until(velocity(), lambda v: v.east_m_s > 1.0, 10, "set_acceleration_ned")
        await o.set_velocity_ned(VelocityNedYaw(0.0, 0.0, -1.0, 0.0))
        await until(self.telemetry.position_velocity_ned(), lambda s: s.position.down_m < -8, 30, "climb")
        hover = await self.drone.param.get_param_float("MPC_THR_HOVER")
        await o.set_attitude(Attitude(10.0, 0.0, 0.0, hover * 1.02))
        await until(velocity(), lambda v: v.east_m_s > 1.0, 10, "set_attitude: rolled right flies east")
        await o.set_position_ned(PositionNedYaw(0.0, 0.0, -6.0, 0.0))
        await self.at((0.0, 0.0, -6.0), 30, "back")
        await o.stop()
        await self.mode(FlightMode.HOLD)

    async def mission(self) -> None:
        lat, lon, nan = 47.397742, 8.545594, math.nan
        none, keep = MissionItem.CameraAction.NONE, MissionItem.VehicleAction.NONE
        items = [
            MissionItem(
                lat + n / 111190, lon + e / 75400, 6.0, 5.0, True, nan, nan, none, nan, nan, 1.0, nan, nan, keep
            )
            for n, e in ((10, 0), (10, 10), (0, 10))
        ]
        plugin = self.drone.mission
        await plugin.upload_mission(MissionPlan(items))
        assert len((await plugin.download_mission()).mission_items) == 3
        await plugin.start_mission()
        await until(plugin.mission_progress(), lambda p: p.current >= 1, 30, "first item")
        await plugin.pause_mission()
        await self.mode(FlightMode.HOLD)
        await plugin.start_mission()
        await until(plugin.mission_progress(), lambda p: p.current == p.total == 3, 40, "finished")
        await plugin.clear_mission()
        assert not (await plugin.download_mission()).mission_items

    async def fence(self) -> None:
        lat, lon = 47.397742, 8.545594
        corners = [Point(lat + n, lon + e) for n, e in ((-1e-3, -1e-3), (1e-3, -1e-3), (1e-3, 1e-3), (-1e-3, 1e-3))]
        await self.drone.geofence.upload_geofence(GeofenceData([Polygon(corners, FenceType.INCLUSION)], []))
        await self.drone.geofence.clear_geofence()

    async def refuses_ftp(self) -> str:
        try:
            await asyncio.wait_for(self.drone.ftp.list_directory("/"), 8)
        except FtpError as error:
            return str(error)[:80]
        raise AssertionError("not refused")

    async def refuses_calibration(self) -> str:
        try:
            await first(self.drone.calibration.calibrate_gyro(), 8)
        except CalibrationError as error:
            return str(error)[:80]
        raise AssertionError("not refused")

    async def refuses_camera_and_gimbal(self) -> str:
        notes = []
        for asked in (
            self.drone.camera.take_photo(1),
            self.drone.gimbal.set_angles(1, 0.0, 0.0, 0.0, GimbalMode.YAW_FOLLOW, SendMode.ONCE),
        ):
            try:
                await asyncio.wait_for(asked, 8)
            except (CameraError, GimbalError) as error:
                notes.append(str(error)[:30])
        assert len(notes) == 2, f"refused: {notes}"
        return ", ".join(notes)

    async def returns(self) -> None:
        await self.drone.param.set_param_float("RTL_RETURN_ALT", 8.0)
        await self.action.return_to_launch()
        await self.mode(FlightMode.RETURN_TO_LAUNCH)
        await until(self.telemetry.armed(), lambda armed: not armed, 60, "landed and disarmed")

    async def lands(self) -> None:
        await self.action.arm()
        await self.action.takeoff()
        await until(self.telemetry.in_air(), bool, 10, "in air")
        await self.action.land()
        await until(self.telemetry.armed(), lambda armed: not armed, 40, "landed and disarmed")


STEPS = (
    "health", "every_stream", "info", "parameters", "parameter_of_wrong_type", "set_rates", "refuses_calibration",
    "refuses_what_it_cannot",
    "arm_and_takeoff", "goto", "set_points", "mission", "fence", "refuses_ftp",
    "refuses_camera_and_gimbal", "returns", "lands",
)  # fmt: skip


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


async def main() -> None:
    drone = System(port=free_port())
    await asyncio.wait_for(drone.connect(system_address=sys.argv[1]), 20)
    await until(drone.core.connection_state(), lambda state: state.is_connected, 15, "a connection")
    print(json.dumps({"step": "connect", "ok": True, "note": ""}), flush=True)
    flight = Flight(drone)
    for name in sys.argv[2:] or STEPS:
        begin = time.monotonic()
        try:
            note, ok = await asyncio.wait_for(getattr(flight, name)(), 120) or "", True
        except Exception as error:  # noqa: BLE001
            note, ok = f"{type(error).__name__}: {error}", False
        print(json.dumps({"step": name, "ok": ok, "note": note, "s": round(time.monotonic() - begin, 2)}), flush=True)
    drone._stop_mavsdk_server()
    os._exit(0)  # gRPC's threads outlive the event loop for minutes


asyncio.run(main())
