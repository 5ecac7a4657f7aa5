"""The loop's book-keeping of one tick, against a link made for the test."""

import time
from collections.abc import Iterator
from unittest.mock import MagicMock

import pytest

from sandwich_sitl.control.solvers.registry import solver_for_flight
from sandwich_sitl.link.session import LinkSession
from sandwich_sitl.mission.vehicle_view import Autopilot, VehicleView
from sandwich_sitl.recording.recorder import RunRecorder
from sandwich_sitl.recording.records import TickTiming
from sandwich_sitl.run import Observers, _Loop

from .test_planner_process import CONFIG, plan


@pytest.fixture
def recorder() -> MagicMock:
    return MagicMock(spec=RunRecorder)


@pytest.fixture
def loop(recorder: MagicMock) -> Iterator[_Loop]:
    made = _Loop(CONFIG, plan(), Observers(recorder, lambda *_: None), lambda: 0, solver_for_flight)
    yield made
    made._watch.close()


def link_to(view: VehicleView) -> MagicMock:
    link = MagicMock(spec=LinkSession)
    link.next_tick.return_value, link.view, link.send.return_value = 0.02, view, None
    link.late_s.return_value = 0.0
    return link


def test_messages_that_are_not_finite_are_told_of_once_each(recorder: MagicMock, loop: _Loop) -> None:
    for names in ((), ("ATTITUDE",), ("LOCAL_POSITION_NED", "ATTITUDE", "LOCAL_POSITION_NED"), (), ("ATTITUDE",)):
        assert loop._tick(link_to(VehicleView(heard=True, autopilot=Autopilot.PX4, not_finite=names))) is None
    told = [call.args[2] for call in recorder.log.call_args_list if "not finite" in call.args[2]]
    assert [text.split()[1] for text in told] == ["ATTITUDE", "LOCAL_POSITION_NED"]


def test_lateness_is_the_links_word_on_when_the_set_point_went_out(recorder: MagicMock, loop: _Loop) -> None:
    link = link_to(VehicleView(heard=True))
    link.late_s.side_effect = lambda wall_s: 0.004 if time.monotonic() - 5.0 < wall_s <= time.monotonic() else -1.0
    assert loop._tick(link) is None
    number, timing = recorder.timing.call_args.args
    assert (number, timing.late_s) == (0, 0.004)
    assert isinstance(timing, TickTiming)
    link.late_s.assert_called_once_with(timing.sent_s)
