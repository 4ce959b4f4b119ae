"""From one vehicle's samples to its state: samples in, clock, position and attitude at any time out."""
