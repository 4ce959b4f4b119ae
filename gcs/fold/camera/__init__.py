"""The camera at each frame: its optics, which way it looks, where it is; found from the film where nothing tells."""
