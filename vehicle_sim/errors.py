"""Every error this package raises on purpose; the command line prints the message as one line and exits 2."""


class VehicleError(Exception):
    """Base of all deliberate errors."""

    exit_status = 2


class ConfigError(VehicleError):
    """The configuration is not usable. The message names file, line, key path and the fix."""


class EndpointError(VehicleError):
    """A connection URI is not understood, or its port cannot be bound."""
