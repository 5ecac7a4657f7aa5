"""The vehicle as MAVLink shows it: messages, and the rates at which each client gets them."""
