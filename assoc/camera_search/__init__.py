"""The search for a camera that nothing describes: its focal length and how it hangs, from the fleet's own motion."""
