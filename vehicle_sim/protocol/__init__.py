"""MAVLink towards clients, without a socket: frames, sessions, and one module for each of the protocols spoken."""
