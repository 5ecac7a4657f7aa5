"""Every error this package raises on purpose.

A message says what was wrong, where, and what would be right; `exit_status` is what the command line exits with.
"""


class SandwichError(Exception):
    """Base of all deliberate errors; the command line prints the message as one line."""

    exit_status = 1


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
