"""A million frames with right checksums and random or mutated payloads: no exception, bounded memory, flyable afterwards.

`SITL_FUZZ_FRAMES` sets another number (10^7 takes about a quarter of an hour).
"""

import math
import os
import random
import resource
import struct
from typing import Any

import pytest
from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.config import VehicleConfig
from vehicle_sim.protocol.inbound import HANDLERS
from vehicle_sim.protocol.node import Node
from vehicle_sim.vehicle import Vehicle

from .node_client import EXACT, Client, in_offboard

FRAMES = int(os.environ.get("SITL_FUZZ_FRAMES", "1000000"))
#: A random key would shut the rest out: SETUP_SIGNING has tests of its own.
LISTENED_TO = set(HANDLERS) - {"SETUP_SIGNING"}
KINDS = [kind for kind in mavlink.mavlink_map.values() if kind.msgname in LISTENED_TO]
OTHERS = [kind for kind in mavlink.mavlink_map.values() if kind.msgname not in HANDLERS]
SPECIAL = [struct.pack("<f", value) for value in (math.nan, math.inf, -math.inf, 1e38, -1e38, 0.0, 1.0, 4.0, 6.0)]
COMMANDS = (176, 400, 22, 21, 20, 192, 178, 511, 512, 420, 193, 224, 300, 185, 179, 17, 246, 2000)


def frame_of(kind: Any, payload: bytes) -> bytes:
    data = payload.rstrip(b"\0") or b"\0"
    head = struct.pack("<BBBBBBBHB", 0xFD, len(data), 0, 0, 0, 245, 190, kind.id & 0xFFFF, kind.id >> 16)
    return head + data + struct.pack("<H", mcrf4xx(head[1:] + data + bytes((kind.crc_extra,))))


def random_frame(rng: random.Random) -> bytes:
    """Addressed to the vehicle more often than not; floats special more often than not."""
    kind = rng.choice(KINDS) if rng.random() < 0.95 else rng.choice(OTHERS)
    payload = bytearray(rng.randbytes(kind.unpacker.size))
    for _ in range(rng.randrange(4)):
        at = 4 * rng.randrange(max(1, len(payload) // 4))
        payload[at : at + 4] = rng.choice(SPECIAL)
    if kind.msgname in ("COMMAND_LONG", "COMMAND_INT"):
        payload[28:30] = struct.pack("<H", rng.choice(COMMANDS))
    offset = 0
    for name, code in zip(kind.ordered_fieldnames, kind.unpacker.format.strip("<"), strict=False):
        if name in ("target_system", "target_component") and code == "B" and rng.random() < 0.9:
            payload[offset] = 1
        offset += struct.calcsize("<" + code) if code.isalpha() else 0
    payload = payload[: kind.unpacker.size]
    raw = bytearray(frame_of(kind, bytes(payload)))
    if rng.random() < 0.1:
        raw[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
    return bytes(raw)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_random_frames_do_no_harm() -> None:
    rng = random.Random(20)
    node = Node(Vehicle(VehicleConfig(sensors=EXACT), 1), lockstep=False)
    client = Client(node)
    in_offboard(client)
    handled, resident = 0, 0
    for k in range(FRAMES):
        for received in client.codec.decode(random_frame(rng)):
            node.handle(client.name, received)
            handled += 1
        if k % 500 == 499:
            node.advance_to(node.vehicle.t_us + 20_000)
            node.take(node.session(client.name))
            node.journal.clear()
            assert all(math.isfinite(value) for value in node.vehicle.state), k
        if k == FRAMES // 5:
            resident = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert handled > 0.7 * FRAMES
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - resident < 30_000
    store = node.vehicle.autopilot.parameters
    for name in store:
        assert math.isfinite(store[name])
    fresh = Node(Vehicle(VehicleConfig(sensors=EXACT), 1), lockstep=False)
    in_offboard(Client(fresh))
    for name in store:
        store.set(name, fresh.vehicle.autopilot.parameters.value(name))
    node.vehicle.failures.inject(101, 0, 0)
    for unit in (2, 3, 4):
        node.vehicle.failures.inject(unit, 0, 0)
    node.vehicle.flight.battery[0] = 1.0
    assert client.results(400, 0, 21196) == [0]
    node.missions._upload = None
    node.vehicle.autopilot.zones = ()
    client.run(30.0)
    assert node.vehicle.state.d == pytest.approx(0.0, abs=1e-6)
    in_offboard(client)
