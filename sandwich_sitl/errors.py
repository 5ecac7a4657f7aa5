"""Every error this package raises on purpose.

A message says what was wrong, where, and what would be right; `exit_status` is what the command line exits with.
"""


def printable(text: str) -> str:
    """The text with control characters written out, so that a file can neither move the cursor nor add lines."""
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in text)


class SandwichError(Exception):
    """Base of all deliberate errors; the message is one line that can be printed, whatever a damaged file put into it."""

    exit_status = 1

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class InputError(SandwichError):
    """A file, key, map, log or option is not usable. The message names the place and the fix."""

    exit_status = 2


class NoRouteError(SandwichError):
    """Start and goal are not connected in free space. The message names the barrier."""

    exit_status = 3


class MapError(SandwichError):
    """The channel map cannot be built or fails its own check, so it is refused."""

    exit_status = 4


class LinkError(SandwichError):
    """The vehicle did not answer before a deadline, or the link could not be opened."""

    exit_status = 5


class MissionError(SandwichError):
    """The vehicle answered but did not do what the mission needs (refused arming, left OFFBOARD, ...)."""

    exit_status = 6
