"""What others than the operator get of a flight or a replay: programs that are told, browsers that are served."""
