"""Ctrl-C in flight is a request to the mission, not an exception in the loop."""

import signal
from types import FrameType, TracebackType
from typing import Any, Self

_NUMBERS = (signal.SIGINT, signal.SIGTERM)


class StopRequests:
    """Context manager that counts SIGINT and SIGTERM: the first one brakes, holds and lands, the second one lands at once."""

    def __init__(self) -> None:
        self._count = 0
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        self._before = {number: signal.signal(number, self._on_signal) for number in _NUMBERS}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __call__(self) -> int:
        return self._count

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self._count += 1
