"""What people see while a run goes on: a live line on a terminal, plain lines elsewhere."""

import sys
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.status import Status


class Progress:
    """Context manager that shows stages of planning and the state of the flight on standard error."""

    def __init__(self) -> None:
        self._console = Console(stderr=True, highlight=False)
        self._status: Status | None = None
        self._state = ""

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._status = self._console.status("")
            self._status.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._status is not None:
            self._status.stop()

    def stage(self, name: str) -> None:
        """A stage of planning begins."""
        if self._status is not None:
            self._status.update(f"plan: {name}")
        else:
            self.note(f"plan: {name}")

    def flight(self, now_s: float, state: str, text: str) -> None:
        """The flight is in `state`; told at every change, when there is something to say, and about once a second."""
        changed, self._state = state != self._state or bool(text), state
        line = f"t {now_s:7.2f} s  {state}" + (f"  {text}" if text else "")
        if changed:
            self.note(line)
        if self._status is not None:
            self._status.update(f"fly: {line}")

    def note(self, text: str) -> None:
        """One line that stays."""
        if self._status is not None:
            self._console.print(text, markup=False)
        else:
            print(text, file=sys.stderr, flush=True)
