"""Signing: an independent signer (pymavlink) is heard and hears; unsigned, replayed, wrong-key and version-1 frames are not."""

from hashlib import sha256
from typing import Any

import pytest
from pymavlink.dialects.v10 import common as mavlink1
from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.config import VehicleConfig
from vehicle_sim.protocol.node import Node
from vehicle_sim.protocol.signing import Refused, Signing, key_of
from vehicle_sim.vehicle import Vehicle

PASSPHRASE = "correct horse"
FAR_FUTURE = 2**47


def signer(passphrase: str = PASSPHRASE, stamp: int = 1000, link: int = 3) -> Any:
    """pymavlink with signing on: the independent second way."""
    mav = mavlink.MAVLink(None, 255, 190)
    mav.signing.secret_key = sha256(passphrase.encode()).digest()
    mav.signing.link_id, mav.signing.timestamp, mav.signing.sign_outgoing = link, stamp, True
    mav.signing.allow_unsigned_callback = lambda _self, _number: False
    return mav


@pytest.fixture
def node() -> Node:
    return Node(Vehicle(VehicleConfig(), 1), lockstep=False, signing=Signing(key_of(PASSPHRASE), 0))


def heard(node: Node, frame: bytes) -> bool:
    received = node.new_codec().decode(frame)
    for message in received:
        node.handle("client", message)
    return bool(received)


def hello(mav: Any) -> bytes:
    return bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mav))


def test_a_signed_frame_is_heard_once(node: Node) -> None:
    frame = hello(signer())
    assert heard(node, frame)
    assert not heard(node, frame)
    assert dict(node.signing.refused) == {Refused.REPLAYED: 1}


def test_unsigned_wrong_key_and_version_1_are_refused_and_counted(node: Node) -> None:
    assert not heard(node, hello(mavlink.MAVLink(None, 255, 190)))
    assert not heard(node, hello(signer("wrong")))
    assert not heard(node, mavlink1.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mavlink1.MAVLink(None, 255, 190)))
    assert set(node.signing.refused) == {Refused.UNSIGNED, Refused.WRONG_KEY, Refused.VERSION_1}
    assert node.sessions == {}


def test_a_forged_stamp_from_the_far_future_shuts_nobody_out(node: Node) -> None:
    assert heard(node, hello(signer(stamp=1000)))
    forged = bytearray(hello(signer("wrong", FAR_FUTURE)))
    assert not heard(node, bytes(forged))
    assert heard(node, hello(signer(stamp=2000)))
    assert node.signing.stamp < FAR_FUTURE


def test_the_key_holders_streams_are_apart_and_old_ones_are_too_old(node: Node) -> None:
    node.signing.reach_us(10**9)
    assert heard(node, hello(signer(stamp=10**8, link=1)))
    assert heard(node, hello(signer(stamp=10**8 - 5, link=2)))
    assert not heard(node, hello(signer(stamp=10**8 - 60 * 100_000 - 1 - 10**7, link=4)))
    assert node.signing.refused[Refused.TOO_OLD] == 1


def test_what_the_vehicle_sends_verifies_with_pymavlink_and_is_deterministic() -> None:
    def fly() -> list[bytes]:
        node = Node(Vehicle(VehicleConfig(), 1), lockstep=False, signing=Signing(key_of(PASSPHRASE), 77))
        session = node.session("client")
        node.advance_to(1_000_000)
        return node.take(session)

    frames = fly()
    verifier = signer()
    messages = [verifier.decode(bytearray(frame)) for frame in frames]
    assert len(messages) > 300
    assert all(frame[2] & 1 for frame in frames)
    assert frames == fly()
    stamps = [int.from_bytes(frame[-12:-6], "little") for frame in frames]
    assert stamps == sorted(set(stamps))


def test_one_flipped_bit_anywhere_is_noticed(node: Node) -> None:
    frame = hello(signer())
    for at in range(len(frame)):
        broken = bytearray(frame)
        broken[at] ^= 0x10
        assert not heard(node, bytes(broken)), at
    assert heard(node, frame)


def key_message(passphrase: str, stamp: int = 5000) -> Any:
    key = list(sha256(passphrase.encode()).digest()) if passphrase else [0] * 32
    return mavlink.MAVLink_setup_signing_message(1, 1, key, stamp)


@pytest.fixture
def open_node() -> Node:
    return Node(Vehicle(VehicleConfig(), 1), lockstep=False)


def test_the_first_key_is_taken_from_anyone_and_the_next_from_its_holder(open_node: Node) -> None:
    plain, other = mavlink.MAVLink(None, 255, 190), signer("other", stamp=9000)
    assert heard(open_node, hello(plain))
    assert heard(open_node, key_message(PASSPHRASE).pack(plain))
    assert not heard(open_node, hello(plain))
    assert not heard(open_node, key_message("other").pack(plain))
    mine = signer(stamp=9000)
    assert heard(open_node, hello(mine))
    open_node.take(open_node.session("client"))
    open_node.advance_to(1_000_000)
    assert all(frame[2] & 1 for frame in open_node.take(open_node.session("client")))
    assert heard(open_node, key_message("other").pack(mine))
    assert not heard(open_node, hello(mine))
    assert heard(open_node, hello(other))
    assert heard(open_node, key_message("", 0).pack(other))
    assert not open_node.signing.is_on
    assert heard(open_node, hello(plain))


def test_the_key_is_not_changed_in_flight_or_by_a_message_for_another_vehicle(open_node: Node) -> None:
    plain = mavlink.MAVLink(None, 255, 190)
    heard(open_node, mavlink.MAVLink_setup_signing_message(7, 1, [1] * 32, 5).pack(plain))
    assert not open_node.signing.is_on
    open_node.vehicle.autopilot.commander.armed = True
    heard(open_node, key_message(PASSPHRASE).pack(plain))
    assert not open_node.signing.is_on


@pytest.mark.parametrize("number", [109, 246, 247])
def test_what_radios_and_other_traffic_send_needs_no_signature(node: Node, number: int) -> None:
    kind = mavlink.mavlink_map[number]
    zeros = [[0] * size if size else b"" if kind_of == "char" else 0 for size, kind_of in sizes(kind)]
    assert heard(node, kind(*zeros).pack(mavlink.MAVLink(None, 51, 68)))


def sizes(kind: Any) -> list[tuple[int, str]]:
    by_name = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    pairs = zip(kind.fieldnames, kind.fieldtypes, strict=True)
    return [(0 if of == "char" else by_name[name], of) for name, of in pairs]
