"""The ground plane as the camera sees it: rays and a pose correction in, places on the ground out."""
