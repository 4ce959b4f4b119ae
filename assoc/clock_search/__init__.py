"""Search for the offset of a fleet's clock from a film's, from how the fleet fits the picture: within hours, to 0.1 s.

In: tracks of the film as rays, the camera's path, the fleet's positions with their own times. Out: the offset with its
1σ, the runner-up and the evidence for both, or none that can be relied on.
"""
