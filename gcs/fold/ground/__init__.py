"""The ground below the camera: height, slope and relief, and where boxes and reports meet it."""
