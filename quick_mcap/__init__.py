"""MCAP files written at the pace of a control loop. Knows neither of the two programs that use it."""
