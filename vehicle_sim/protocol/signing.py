"""MAVLink 2 message signing (mavlink.io, "Message Signing"): what leaves is signed, what comes in must be.

    signature = first 6 bytes of SHA-256(key, header, payload, checksum, link id, time stamp)        time stamp in units of 10 us

State: the key, and the last accepted time stamp of every (system, component, link). A stamp moves only after the hash has been found
right, so a forged one from the far future shuts nobody out. Refusals are counted by reason. Without a key nothing is signed and everything
is listened to; SETUP_SIGNING gives, changes and takes the key, as PX4 has it (docs.px4.io, "MAVLink Message Signing").
"""

from collections import Counter
from enum import Enum
from hashlib import sha256
from hmac import compare_digest

SIGNATURE_BYTES = 13
SIGNED_FLAG = 0x01
MAX_STREAMS = 64
_NEW_STREAM_SLACK = 60 * 100_000
#: What other systems send that cannot sign: RADIO_STATUS, ADSB_VEHICLE, COLLISION.
_ALWAYS_HEARD = (109, 246, 247)


class Refused(Enum):
    """Why a frame is not listened to."""

    UNSIGNED = "unsigned"
    VERSION_1 = "version 1"
    WRONG_KEY = "wrong key"
    REPLAYED = "replayed"
    TOO_OLD = "too old"
    TOO_MANY = "too many streams"


def key_of(passphrase: str) -> bytes:
    """32 bytes, as ground stations make them of a passphrase."""
    return sha256(passphrase.encode()).digest()


class Signing:
    """One vehicle's key and clock; `stamp` is the newest time stamp made or believed."""

    def __init__(self, key: bytes | None = None, epoch: int = 0) -> None:
        """`epoch` is the time stamp at boot."""
        self._key = key or b""
        self._epoch = epoch
        self.stamp = epoch
        self._streams: dict[tuple[int, int, int], int] = {}
        self.refused: Counter[Refused] = Counter()

    @property
    def is_on(self) -> bool:
        """There is a key."""
        return bool(self._key)

    def set_up(self, key: bytes, stamp: int) -> None:
        """A new key and its first time stamp; both zero: no signing any more."""
        self._key = key if any(key) or stamp else b""
        self.stamp = max(self.stamp, stamp)
        self._streams.clear()

    def sign(self, frame: bytes, link_id: int) -> bytes:
        """The frame (with its signed flag already set) and its signature."""
        self.stamp += 1
        tail = bytes((link_id,)) + self.stamp.to_bytes(6, "little")
        return frame + tail + sha256(self._key + frame + tail).digest()[:6]

    def reach_us(self, t_us: int) -> None:
        """The clock says so many microseconds since boot."""
        self.stamp = max(self.stamp, self._epoch + t_us // 10)

    def problem(self, frame: bytes) -> Refused | None:
        """None when the frame may be listened to."""
        refused = self._check(frame) if self._key else None
        if refused is not None:
            self.refused[refused] += 1
        return refused

    def _check(self, frame: bytes) -> Refused | None:
        if frame[0] != 0xFD:
            return Refused.VERSION_1
        if not frame[2] & SIGNED_FLAG:
            return None if int.from_bytes(frame[7:10], "little") in _ALWAYS_HEARD else Refused.UNSIGNED
        if not compare_digest(sha256(self._key + frame[:-6]).digest()[:6], frame[-6:]):
            return Refused.WRONG_KEY
        stream = (frame[5], frame[6], frame[-13])
        stamp = int.from_bytes(frame[-12:-6], "little")
        last = self._streams.get(stream)
        if last is None:
            if stamp + _NEW_STREAM_SLACK < self.stamp:
                return Refused.TOO_OLD
            if len(self._streams) >= MAX_STREAMS:
                return Refused.TOO_MANY
        elif stamp <= last:
            return Refused.REPLAYED
        self._streams[stream] = stamp
        return None
