"""A quadcopter behind a PX4-like autopilot that speaks MAVLink 2 over UDP. Entry point: `vehicle_sim.cli:main`."""
