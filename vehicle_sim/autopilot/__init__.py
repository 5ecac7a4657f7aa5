"""A PX4-like autopilot without I/O: parameters, modes, failsafes and control. Time is an argument, in seconds since boot."""
