"""The published association methods: positions of vehicles and boxes of one frame in, costs and assignments out."""
