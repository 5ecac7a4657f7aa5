"""`python -m vehicle_sim.warm_up`: compile the flight kernel and leave its machine code on disk, for the vehicles that come after."""

from vehicle_sim.config import VehicleConfig
from vehicle_sim.vehicle import Vehicle

if __name__ == "__main__":
    Vehicle(VehicleConfig(), seed=1).warm_up()
