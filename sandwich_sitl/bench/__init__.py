"""Measurements of parts of the program, each a subcommand of `sandwich-sitl bench`."""
