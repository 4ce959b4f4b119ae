"""What an import costs: names of simulated flights as recorded, and by what a drone's subtitles tell of them."""
