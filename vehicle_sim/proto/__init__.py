"""Generated protobuf messages of the vehicle's log."""
