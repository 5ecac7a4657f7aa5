"""MAVLink to and from the mission's dataclasses: sockets, frames, messages, clocks. The only room that knows NED."""
