"""Pauses of this process, of the vehicle's and of both, played on a clock of the test's own: afterwards the run clock is
the vehicle's again, and it has never gone back.
"""

from collections.abc import Iterator

import pytest
from pymavlink.dialects.v20 import common as mavlink

from sandwich_sitl.link import pacing
from sandwich_sitl.link.inbox import Inbox
from sandwich_sitl.link.pacing import RealtimePacer
from sandwich_sitl.link.telemetry import Telemetry

PERIOD_S = 0.02
DELAY_S = 0.001


class Hosts:
    """Wall clock, vehicle and wire. The vehicle sends its boot time every 10 ms; each process may be `paused` at times."""

    datagrams = True

    def __init__(self, here: tuple[float, float], vehicle: tuple[float, float]) -> None:
        self.now = 0.0
        self._here, self._vehicle = here, vehicle
        encoder = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._heartbeat = encoder.heartbeat_encode(2, 12, 0, 0, 3).pack(encoder)
        self._encoder = encoder
        self._sent = 0

    def monotonic(self) -> float:
        self.now += 1e-5
        begin, end = self._here
        if begin <= self.now < end:
            self.now = end
        return self.now

    def boot_s(self, wall: float) -> float:
        """The vehicle's boot time, 5 s ahead; what it spends paused is lost."""
        begin, end = self._vehicle
        return 5.0 + wall - min(max(wall - begin, 0.0), end - begin)

    def receive(self, deadline: float) -> bytes | None:
        due = self._due()
        if due > max(deadline, self.now):
            self.now = max(self.now, deadline)
            return None
        self.now = max(self.now, due)
        boot_ms = round(1e3 * self.boot_s(due - DELAY_S))
        self._sent += 1
        return bytes(self._heartbeat + self._encoder.system_time_encode(0, boot_ms).pack(self._encoder))

    def _due(self) -> float:
        sent = 0.01 * self._sent
        begin, end = self._vehicle
        return DELAY_S + (sent if sent < begin else sent + end - begin)

    def send(self, datagram: bytes) -> None:
        del datagram

    def keep_peer(self) -> None:
        return


def ticks(hosts: Hosts, monkeypatch: pytest.MonkeyPatch, until_s: float) -> Iterator[tuple[float, float]]:
    """Run clock and the vehicle's boot time at each tick."""
    monkeypatch.setattr(pacing, "time", hosts)
    inbox = Inbox(Telemetry((0.0, 0.0), (245, 191)), lambda *_: None)
    pacer = RealtimePacer(hosts, inbox, PERIOD_S, 1.0, 2.0, lambda _: None)
    while hosts.now < until_s:
        now_s = pacer.next_tick()
        if pacer.heard:
            yield now_s, hosts.boot_s(hosts.now)


NEVER = (1e9, 1e9)


@pytest.mark.parametrize(
    ("here", "vehicle"),
    [
        (NEVER, NEVER),
        ((2.0, 2.05), NEVER),
        ((2.0, 2.7), NEVER),
        ((2.0, 4.9), NEVER),
        (NEVER, (2.0, 2.7)),
        (NEVER, (2.0, 3.8)),
        ((2.0, 2.7), (2.0, 2.7)),
        ((2.0, 6.0), (2.0, 6.0)),
        ((2.0, 2.9), (2.1, 2.7)),
    ],
    ids=[
        "none",
        "a late tick",
        "here",
        "here, long",
        "vehicle",
        "vehicle, long",
        "both",
        "both, long",
        "both, not alike",
    ],
)
def test_after_a_pause_the_run_clock_is_the_vehicles_again(
    here: tuple[float, float], vehicle: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    hosts = Hosts(here, vehicle)
    last, apart = 0.0, []
    for now_s, boot_s in ticks(hosts, monkeypatch, 12.0):
        assert now_s >= last
        last = now_s
        apart.append(now_s - boot_s)
    assert max(map(abs, apart[:50])) < 0.005
    assert max(map(abs, apart[-50:])) < 0.012
    if vehicle is NEVER:  # what has queued up meanwhile is read in a tick or two
        assert sum(abs(distance) > 0.012 for distance in apart) <= 2


def test_a_silence_that_lasts_is_a_lost_vehicle(monkeypatch: pytest.MonkeyPatch) -> None:
    hosts = Hosts(NEVER, (2.0, 9.0))
    with pytest.raises(pacing.LinkError, match="silent for 2 s"):
        list(ticks(hosts, monkeypatch, 12.0))


def test_a_set_point_is_late_by_the_end_of_its_period_however_late_the_tick_began(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A tick that begins 19 ms late and takes 5 ms leaves 4 ms after its period of 20 ms; the next is on time again."""
    due_s = 50 * PERIOD_S
    hosts = Hosts((due_s - 0.001, due_s + 0.019), NEVER)
    monkeypatch.setattr(pacing, "time", hosts)
    pacer = RealtimePacer(
        hosts, Inbox(Telemetry((0.0, 0.0), (245, 191)), lambda *_: None), PERIOD_S, 1.0, 2.0, lambda _: None
    )
    late_s = []
    for _ in range(53):
        pacer.next_tick()
        hosts.now += 0.005
        late_s.append(pacer.late_s(hosts.now))
    assert late_s[50] == pytest.approx(0.004, abs=2e-4)
    assert late_s[:50] == [0.0] * 50
    assert late_s[51:] == [0.0, 0.0]
