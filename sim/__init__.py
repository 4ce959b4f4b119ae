"""A simulated flight: world, traffic, telemetry with errors, camera, renderer, truth. Independent of the code it tests."""
