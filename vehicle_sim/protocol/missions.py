"""The mission protocol for missions and fences (rally points: an empty list): upload, download, clear. PX4: retry 250 ms, time-out 5 s.

State: the lists as they were uploaded, and one upload under way. No clock: `poll(t_us)` is told the time.
"""

from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.results import Severity
from vehicle_sim.protocol.codec import Received
from vehicle_sim.protocol.mission_items import WireItem, fence_zones, find_problem, mission_item, wire_item
from vehicle_sim.protocol.session import Session
from vehicle_sim.vehicle import Vehicle

RETRY_US = 250_000
TIMEOUT_US = 5_000_000
NEVER_US = 2**63
MAX_ITEMS = 500
MISSION, FENCE, RALLY, ALL = 0, 1, 2, 255
_OK, _CANCELLED, _SEQUENCE = mavlink.MAV_MISSION_ACCEPTED, mavlink.MAV_MISSION_OPERATION_CANCELLED, 13
_NO_SPACE, _UNSUPPORTED = mavlink.MAV_MISSION_NO_SPACE, mavlink.MAV_MISSION_UNSUPPORTED
_INVALID, _ERROR = mavlink.MAV_MISSION_INVALID, mavlink.MAV_MISSION_ERROR


@dataclass
class Upload:
    """A list on its way in."""

    session: Session
    partner: tuple[int, int]
    kind: int
    count: int
    items: list[WireItem] = field(default_factory=list)
    asked_us: int = 0
    heard_us: int = 0


class MissionManager:
    """One list of each kind; any client may read, one uploads at a time."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._lists: dict[int, list[WireItem]] = {MISSION: [], FENCE: [], RALLY: []}
        self._upload: Upload | None = None

    @property
    def next_us(self) -> int:
        """When `poll` has something to do."""
        return self._upload.asked_us + RETRY_US if self._upload is not None else NEVER_US

    def poll(self, t_us: int) -> None:
        """Ask again for an item that does not come, and give up after 5 s."""
        upload = self._upload
        if upload is None:
            return
        if t_us - upload.heard_us > TIMEOUT_US:
            self._upload = None
            self._vehicle.autopilot.commander.say(Severity.WARNING, "Operation timeout")
        elif t_us - upload.asked_us >= RETRY_US:
            self._ask(upload)

    def on_list(self, session: Session, received: Received) -> None:
        """MISSION_REQUEST_LIST."""
        kind = received.message.mission_type
        if kind not in self._lists:
            self._acknowledge(session, received, _UNSUPPORTED)
            return
        session.send(mavlink.MAVLink_mission_count_message(*_partner(received), len(self._lists[kind]), kind))

    def on_request(self, session: Session, received: Received) -> None:
        """MISSION_REQUEST_INT and MISSION_REQUEST."""
        m = received.message
        items = self._lists.get(m.mission_type, [])
        if m.seq >= len(items):
            self._acknowledge(session, received, _SEQUENCE)
            return
        session.send(self._item(received, m.seq, items[m.seq], m.get_type() == "MISSION_REQUEST"))

    def on_count(self, session: Session, received: Received) -> None:
        """MISSION_COUNT begins an upload."""
        m = received.message
        if m.mission_type not in self._lists or (m.mission_type == RALLY and m.count):
            self._acknowledge(session, received, _UNSUPPORTED)
        elif m.count > MAX_ITEMS:
            self._acknowledge(session, received, _NO_SPACE)
        elif self._upload is not None and self._upload.partner != _partner(received):
            self._acknowledge(session, received, _ERROR)
        elif m.count == 0:
            self._acknowledge(session, received, self._store(m.mission_type, []))
        else:
            self._upload = Upload(session, _partner(received), m.mission_type, m.count)
            self._upload.heard_us = self._vehicle.t_us
            self._ask(self._upload)

    def on_item(self, session: Session, received: Received) -> None:
        """MISSION_ITEM_INT or MISSION_ITEM: the one that was asked for, or it is asked for again."""
        upload, m = self._upload, received.message
        if upload is None or upload.session is not session or upload.kind != m.mission_type:
            self._acknowledge(session, received, _ERROR)
            return
        upload.heard_us = self._vehicle.t_us
        if m.seq != len(upload.items):
            self._ask(upload)
            return
        item = wire_item(m)
        problem = find_problem(item, upload.kind == FENCE)
        if problem != _OK:
            self._upload = None
            self._acknowledge(session, received, problem)
            return
        upload.items.append(item)
        if len(upload.items) < upload.count:
            self._ask(upload)
            return
        self._upload = None
        self._acknowledge(session, received, self._store(upload.kind, upload.items))

    def on_clear(self, session: Session, received: Received) -> None:
        """MISSION_CLEAR_ALL."""
        kind = received.message.mission_type
        kinds = list(self._lists) if kind == ALL else [kind] if kind in self._lists else []
        for each in kinds:
            self._store(each, [])
        self._acknowledge(session, received, _OK if kinds else _UNSUPPORTED)

    def on_acknowledgement(self, _session: Session, received: Received) -> None:
        """MISSION_ACK: the end of a download, or an upload called off."""
        if self._upload is not None and received.message.type == _CANCELLED:
            self._upload = None

    def on_set_current(self, session: Session, received: Received) -> None:
        """MISSION_SET_CURRENT is answered by MISSION_CURRENT."""
        if not self._vehicle.autopilot.steering.mission.select(received.message.seq):
            self._vehicle.autopilot.commander.say(Severity.CRITICAL, "WPM: WP CURR CMD: Not in list")
        session.request(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT)

    def _store(self, kind: int, items: list[WireItem]) -> int:
        vehicle = self._vehicle
        if kind == FENCE:
            zones = fence_zones(vehicle, items)
            if zones is None:
                return int(_INVALID)
            vehicle.autopilot.zones = zones
        elif kind == MISSION:
            vehicle.autopilot.steering.mission.replace([mission_item(vehicle, item) for item in items])
        self._lists[kind] = items
        return int(_OK)

    def _ask(self, upload: Upload) -> None:
        upload.asked_us = self._vehicle.t_us
        kind = mavlink.MAVLink_mission_request_int_message
        upload.session.send(kind(*upload.partner, len(upload.items), upload.kind))

    def _item(self, received: Received, number: int, item: WireItem, with_floats: bool) -> Any:
        mission = self._vehicle.autopilot.steering.mission
        current = int(received.message.mission_type == MISSION and number == mission.current)
        head = (*_partner(received), number, item.frame, item.command, current, item.autocontinue, *item.parameters)
        kind = received.message.mission_type
        if with_floats:
            return mavlink.MAVLink_mission_item_message(*head, item.x / 1e7, item.y / 1e7, item.z, kind)
        return mavlink.MAVLink_mission_item_int_message(*head, item.x, item.y, item.z, kind)

    def _acknowledge(self, session: Session, received: Received, verdict: int) -> None:
        kind = received.message.mission_type
        session.send(mavlink.MAVLink_mission_ack_message(*_partner(received), verdict, kind))


def _partner(received: Received) -> tuple[int, int]:
    return received.system_id, received.component_id
