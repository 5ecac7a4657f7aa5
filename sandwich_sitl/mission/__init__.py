"""The offboard mission: what the process asks of the autopilot, as a table without I/O or clock."""
