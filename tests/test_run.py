"""The loop's book-keeping of one tick, against a link made for the test."""

import time
from unittest.mock import MagicMock

from sandwich_sitl.control.solvers.registry import solver_for_flight
from sandwich_sitl.link.session import LinkSession
from sandwich_sitl.mission.vehicle_view import VehicleView
from sandwich_sitl.recording.recorder import RunRecorder
from sandwich_sitl.recording.records import TickTiming
from sandwich_sitl.run import Observers, _Loop

from .test_planner_process import CONFIG, plan


def test_lateness_is_the_links_word_on_when_the_set_point_went_out() -> None:
    recorder, link = MagicMock(spec=RunRecorder), MagicMock(spec=LinkSession)
    link.next_tick.return_value, link.view, link.send.return_value = 3.0, VehicleView(heard=True), None
    link.late_s.side_effect = lambda wall_s: 0.004 if time.monotonic() - 5.0 < wall_s <= time.monotonic() else -1.0
    loop = _Loop(CONFIG, plan(), Observers(recorder, lambda *_: None), lambda: 0, solver_for_flight)
    try:
        assert loop._tick(link) is None
    finally:
        loop._watch.close()
    number, timing = recorder.timing.call_args.args
    assert (number, timing.late_s) == (0, 0.004)
    assert isinstance(timing, TickTiming)
    link.late_s.assert_called_once_with(timing.sent_s)
